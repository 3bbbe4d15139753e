# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of input files: regular files are read, other files are refused without waiting."""

import os
from pathlib import Path

import pytest

from checkweigher_core.input_files import read_input


def test_only_a_file_or_a_link_to_one_is_read(tmp_path: Path):
    (tmp_path / 'file').write_text('text')
    (tmp_path / 'good').symlink_to('file')
    os.mkfifo(tmp_path / 'pipe')
    (tmp_path / 'link').symlink_to('/dev/zero')
    assert read_input(tmp_path / 'good') == b'text'
    faults = {'pipe': 'not a reg', 'link': 'not a reg', '.': 'dir', 'x': 'No such'}
    for name, what in faults.items():
        with pytest.raises(OSError, match=what):
            read_input(tmp_path / name)
