# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Folders for copies of bags: gone at the end, and those of a killed process at the next one."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import tempfile

import pytest

from checkweigher_recording.scratch import remove_abandoned, scratch_folder

HOLDS_ONE = """
import sys, time
from checkweigher_recording.scratch import scratch_folder
with scratch_folder() as folder:
    (folder / 'copy').mkdir()
    print(folder, flush=True)
    time.sleep(600)
"""


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path))
    return tmp_path


def test_a_folder_goes_at_the_end_also_with_an_error(temporary: Path):
    def spoilt() -> None:
        with scratch_folder() as folder:
            (folder / 'file').touch()
            raise ValueError('wrong')

    with pytest.raises(ValueError, match='wrong'):
        spoilt()
    assert list(temporary.iterdir()) == []


def test_what_a_killed_process_left_goes_and_what_is_in_use_stays(temporary: Path):
    process = subprocess.Popen(
        [sys.executable, '-c', HOLDS_ONE], env={**os.environ, 'TMPDIR': str(temporary)},
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout is not None
    left = Path(process.stdout.readline().strip())
    (temporary / 'checkweigher-of-another-kind').mkdir()
    with scratch_folder() as own:
        remove_abandoned()
        assert own.is_dir()
        assert (left / 'copy').is_dir()
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert (left / 'copy').is_dir()
        with scratch_folder():
            assert not left.exists()
        assert own.is_dir()
    assert [each.name for each in temporary.iterdir()] == ['checkweigher-of-another-kind']


def test_a_link_of_such_a_name_is_not_followed(temporary: Path):
    (temporary / 'kept').mkdir()
    (temporary / 'kept/file').touch()
    (temporary / 'checkweigher-bag-link').symlink_to(temporary / 'kept')
    remove_abandoned()
    assert (temporary / 'kept/file').exists()
