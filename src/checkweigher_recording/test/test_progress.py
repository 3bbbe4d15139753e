# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bar of what takes long, on a terminal and elsewhere."""

from io import StringIO

import pytest

from checkweigher_recording import progress
from checkweigher_recording.progress import with_progress


class Terminal(StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize('delay', [0.0, 3600.0])
@pytest.mark.parametrize('count', [0, 1, 2, 30])
def test_all_pass_through_whether_there_is_a_bar_or_not(monkeypatch, count, delay):
    monkeypatch.setattr('sys.stderr', terminal := Terminal())
    monkeypatch.setattr(progress, '_DELAY', delay)

    assert list(with_progress(range(count), 'reading', unit='chunks')) == list(range(count))
    assert ('reading' in terminal.getvalue()) == (not delay)


def test_there_is_no_bar_without_a_terminal(monkeypatch):
    monkeypatch.setattr('sys.stderr', StringIO())
    monkeypatch.setattr(progress, '_DELAY', 0.0)

    assert with_progress(numbers := range(3), 'reading') is numbers
    monkeypatch.setattr('sys.stderr', Terminal())
    assert with_progress(numbers, 'reading', shown=False) is numbers
