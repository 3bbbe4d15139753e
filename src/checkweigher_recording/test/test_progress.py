# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bar of what takes long, on a terminal and elsewhere."""

import sys

import pytest

from checkweigher_recording import progress
from checkweigher_recording.progress import PROGRESS, read_progress, with_progress


@pytest.mark.parametrize('delay', [0.0, 3600.0])
@pytest.mark.parametrize('count', [0, 1, 2, 30])
def test_all_pass_through_whether_there_is_a_bar_or_not(monkeypatch, capsys, count, delay):
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: True)
    monkeypatch.setattr(progress, '_DELAY', delay)

    assert list(with_progress(range(count), 'reading')) == list(range(count))
    assert ('reading' in capsys.readouterr().err) == (not delay)


@pytest.mark.parametrize(('terminal', 'shown'), [(False, True), (True, False)])
def test_there_is_no_bar_without_a_terminal_or_a_wish(monkeypatch, capsys, terminal, shown):
    monkeypatch.setattr(sys.stderr, 'isatty', lambda: terminal)
    monkeypatch.setattr(progress, '_DELAY', 0.0)

    assert with_progress(numbers := range(3), 'reading', shown=shown) is numbers


def test_a_program_reads_the_progress_from_lines(monkeypatch, capsys):
    monkeypatch.setenv(PROGRESS, 'lines')
    monkeypatch.setattr(progress, '_DELAY', 0.0)

    assert list(with_progress([1.0, 3.0], 'tuning', 4.0, size=float)) == [1.0, 3.0]
    lines = capsys.readouterr().out.splitlines()
    found = [read_progress(line) for line in lines]
    assert [(each.doing, each.share) for each in found] == [('tuning', 0.25), ('tuning', 1.0)]
    assert found[-1].remaining == 0.0
    assert read_progress('estimator  m/min') is None
