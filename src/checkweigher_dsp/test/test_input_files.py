# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of others: read whole, or refused at once."""

import os
from pathlib import Path
import resource

import pytest

from checkweigher_dsp.input_files import open_input, read_input


def test_a_link_to_a_file_is_read(tmp_path: Path):
    (tmp_path / 'file').write_text('text')
    (tmp_path / 'link').symlink_to('file')
    assert read_input(tmp_path / 'link') == b'text'


def test_what_is_no_regular_file_is_refused_at_once(tmp_path: Path):
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('/dev/zero')
    for name in ('pipe', 'link'):
        with pytest.raises(OSError, match='not a regular file'):
            read_input(tmp_path / name)
    with pytest.raises(OSError, match='directory'):
        read_input(tmp_path)


def test_a_file_that_is_too_large_is_refused_unread(tmp_path: Path):
    with (tmp_path / 'large').open('wb') as file:
        file.truncate(1 << 40)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match='larger than 1 MiB'):
        read_input(tmp_path / 'large')
    with pytest.raises(OSError, match='larger than 2048 MiB'):
        open_input(tmp_path / 'large', 1 << 31)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 10_000  # KiB


def test_a_file_that_states_no_size_is_bounded_all_the_same():
    with pytest.raises(OSError, match='larger than 10 bytes'):
        read_input(Path('/proc/self/status'), 10)
