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
    assert ('reading' in terminal.getvalue()) == (count > 0 and not delay)


def test_a_bar_goes_on_from_what_was_done_before_it_appeared(monkeypatch):
    monkeypatch.setattr('sys.stderr', terminal := Terminal())
    monkeypatch.setattr(progress, '_DELAY', 0.0)

    messages = iter(with_progress(iter(range(5)), 'weighing', 5))
    assert [next(messages), next(messages)] == [0, 1]

    assert '1/5' in terminal.getvalue()


def test_there_is_none_where_nobody_looks(monkeypatch):
    monkeypatch.setattr('sys.stderr', StringIO())
    monkeypatch.setattr(progress, '_DELAY', 0.0)

    assert with_progress(numbers := range(3), 'reading') is numbers
    monkeypatch.setattr('sys.stderr', Terminal())
    assert with_progress(numbers, 'reading', shown=False) is numbers
