# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Numbers that outlive the process which gave them, within one run of a line."""

from pathlib import Path
import subprocess
import sys
import time

import pytest

from checkweigher_dsp.nodes.given_numbers import GivenNumbers

PROGRAM = """
import sys
from checkweigher_dsp.nodes.given_numbers import GivenNumbers
numbers = GivenNumbers('/lane/reject', 0)
print(numbers.last)
numbers.give(int(sys.argv[1]))
"""


def give(number: int, *, by: str = '') -> int:
    """Give a number in a process of this one, or of another; return the last one before it."""
    words = [sys.executable, '-c', PROGRAM, str(number)]
    if by:
        words = [sys.executable, '-c', f'import subprocess; subprocess.run({words!r})']
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    return int(done.stdout)


def test_a_process_goes_on_after_the_one_before_it_and_another_run_does_not():
    assert give(57) == 0
    assert give(58) == 57
    assert give(3, by='another') == 0


def test_the_latest_numbers_are_kept():
    numbers = GivenNumbers('/lane/reject', 0, most=3)
    for number in (1, 2, 4, 3, 7):
        numbers.give(number)
    again = GivenNumbers('/lane/reject', 0, most=3)
    again.give(8)

    assert (again.numbers, again.last) == ({4, 3, 7}, 7)
    assert GivenNumbers('/lane/reject', 0, most=3).numbers == {4, 7, 8}


def test_a_restart_loses_no_number_that_was_given_after_a_larger_one():
    given = [1, 2, 5, 3, 4, 6, 9, 7, 8, 10]
    for count, number in enumerate(given):
        numbers = GivenNumbers('/lane/reject', 0, most=len(given))
        assert numbers.numbers == set(given[:count])
        numbers.give(number)
        numbers.close()


def test_with_a_path_numbers_go_on_over_runs(tmp_path, monkeypatch):
    path = str(tmp_path / 'items.numbers')
    GivenNumbers('/lane/segmenter', 0, path).give(57)
    monkeypatch.setattr('checkweigher_dsp.nodes.given_numbers.parent_identity', lambda: 'other')

    again = GivenNumbers('/lane/segmenter', 0, path)
    assert (again.last, again.trouble) == (57, '')


@pytest.mark.parametrize('data', [None, b'', b'\xff\x00', b'a b c', b'1 2 3 \n'])
def test_numbers_that_are_lost_may_be_any_up_to_the_clock(tmp_path: Path, data: bytes | None):
    path = tmp_path / 'verdicts.numbers'
    assert not GivenNumbers('/lane/reject', 0, str(path)).trouble
    GivenNumbers('/lane/reject', 0, str(path)).give(7)
    if data is None:
        path.unlink()
    else:
        path.write_bytes(data)
    before = time.time() * 1e3
    numbers = GivenNumbers('/lane/reject', 0, str(path))
    assert numbers.trouble.startswith(f'{path}: was damaged or removed')
    assert before - 1 <= numbers.last <= time.time() * 1e3


def test_without_a_file_it_says_so_and_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / 'file').touch()
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'file'))
    numbers = GivenNumbers('/lane/reject', 0)
    numbers.give(7)
    assert 'not stored for a restart' in numbers.trouble
