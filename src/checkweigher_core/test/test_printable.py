# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of texts from other sources, which become printable and short."""

import pytest

from checkweigher_core.printable import one_line


@pytest.mark.parametrize(
    ('text', 'line'),
    [
        ('bag: no samples', 'bag: no samples'),
        ('two\n  lines', 'two lines'),
        ('/a\x1b[31mb\x07', r'/a\x1b[31mb\x07'),
        ('Käse 150 g', 'Käse 150 g'),
        ('a\u202eb \ud800', r'a\u202eb \ud800'),
    ],
)
def test_control_characters_are_shown(text: str, line: str):
    assert one_line(text) == line
    assert one_line(text).isprintable()


def test_of_a_long_line_begin_and_end_are_shown():
    line = one_line('begin ' + 'x' * 380_000 + ' end', 100)
    assert len(line) < 110
    assert line.startswith('begin x')
    assert line.endswith('x end')
