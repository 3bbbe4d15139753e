# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of output files: they are written completely, and no device, pipe or link is replaced."""

import os
from pathlib import Path
import stat
import subprocess
import sys
import threading

import pytest

from checkweigher_core.whole_file import OutputError, is_stream, write_whole

NULL, FULL = (os.makedev(1, minor) for minor in (3, 7))


def make_device(folder: Path, number: int) -> Path:
    """Make a character device in the folder of the test."""
    path = folder / 'device'
    try:
        os.mknod(path, 0o600 | stat.S_IFCHR, number)
        path.open('wb').close()
    except PermissionError:
        pytest.skip('devices can be made and opened by root only')
    return path


def test_a_link_stays_and_what_it_names_is_replaced(tmp_path: Path):
    (tmp_path / 'folder').mkdir()
    target, link = tmp_path / 'folder' / 'file', tmp_path / 'link'
    link.symlink_to('folder/file')

    for text in ('first', 'second'):
        write_whole(link, text)

        assert link.is_symlink()
        assert target.read_text() == text
    assert os.listdir(tmp_path / 'folder') == ['file']


def test_links_in_a_circle_are_refused(tmp_path: Path):
    (tmp_path / 'one').symlink_to('other')
    (tmp_path / 'other').symlink_to('one')
    with pytest.raises(OutputError, match='one: cannot be written: Too many levels'):
        write_whole(tmp_path / 'one', 'text')
    assert (tmp_path / 'one').is_symlink()


@pytest.mark.parametrize('linked', [False, True])
def test_a_device_takes_the_text_and_stays(tmp_path: Path, linked: bool):
    device = make_device(tmp_path, NULL)
    path = tmp_path / 'link' if linked else device
    if linked:
        path.symlink_to(device)

    write_whole(path, 'text')

    assert is_stream(path)
    assert stat.S_ISCHR(device.stat().st_mode)
    assert len(os.listdir(tmp_path)) == 1 + linked


def test_a_full_device_is_an_error(tmp_path: Path):
    device = make_device(tmp_path, FULL)
    with pytest.raises(OutputError, match='device: cannot be written: No space left'):
        write_whole(device, 'text')
    assert stat.S_ISCHR(device.stat().st_mode)


def test_a_pipe_takes_the_text_and_stays(tmp_path: Path):
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    with pytest.raises(OutputError, match='no process reads this pipe'):
        write_whole(pipe, 'nobody reads')
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    text = 'a line\n' * 100_000  # more than fits into the buffer of the pipe
    while True:  # repeat until the reader has opened the pipe
        try:
            write_whole(pipe, text)
            break
        except OutputError:
            assert reader.is_alive()
    reader.join()
    assert read == [text]
    assert is_stream(pipe)


def test_the_standard_output_is_not_replaced_where_it_is_a_file(tmp_path: Path):
    script = (
        'from pathlib import Path; from checkweigher_core.whole_file import write_whole\n'
        'print("before"); write_whole(Path("/dev/stdout"), "text\\n"); print("after")'
    )
    with (tmp_path / 'out').open('w') as out:
        subprocess.run([sys.executable, '-c', script], stdout=out, check=True)
    assert (tmp_path / 'out').read_text().split() == ['before', 'text', 'after']
