# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Values out of lines that come in pieces."""

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from checkweigher_driver.serial.ascii import LineDecoder

PATTERN = r'S([+-]\d{7})'


def decode(decoder, pieces):
    found = [decoder.feed(piece) for piece in pieces]
    counts = [count for part in found for count in part.counts.tolist()]
    return counts, [lost for part in found for lost in part.lost.tolist()]


def test_lines_are_values():
    decoder = LineDecoder(PATTERN)
    data = b'25784\r\nS+0125785\r\nS-0000001\rS+9999999\n\nS+0000000\r\nS+01'

    assert decode(decoder, [data]) == ([125785, -1, 9999999, 0], [0, 0, 0, 0])
    assert decoder.skipped_bytes == 5
    assert decoder.bad_frames == 0
    assert decoder.missing == 11 - 4


@pytest.mark.parametrize(
    ('pattern', 'decimals', 'line', 'count'),
    [
        (r'([+-]\d{3}\.\d{4})', 4, b'+012.5785', 125785),
        (r'ST,GS,([+-] *\d+\.\d)kg', 1, b'ST,GS,+12.5kg', 125),
        (r'(?:N|G)(-?\d+)', 0, b'N-42', -42),
    ],
)
def test_a_pattern_finds_the_number(pattern, decimals, line, count):
    assert decode(LineDecoder(pattern, decimals), [b'\n' + line + b'\r\n'])[0] == [count]


@pytest.mark.parametrize(
    ('broken', 'lost'),
    [
        (b'S+01257\r\n', 1),  # digits are lost: not another number
        (b'S+0125x85\r\n', 1),
        (b'S-------\r\n', 1),
        (b'S+0125785S+0125786\r\n', 2),  # the end of a line is lost
        (b'S+99999999\r\n', 1),
    ],
)
def test_what_is_no_value_is_lost(broken, lost):
    good = b'S+0000007\r\n'
    decoder = LineDecoder(PATTERN)

    assert decode(decoder, [good * 3 + broken + good]) == ([7] * 3, [0, 0, lost])
    assert decoder.bad_frames == 1
    assert decoder.skipped_bytes == 9 + len(broken) - 2


def test_a_value_beyond_32_bits_is_none():
    assert decode(LineDecoder(r'(\d+)'), [b'\n4294967296\n12\n'])[0] == [12]
    assert decode(LineDecoder(r'(\d+)', 9), [b'\n1\n3\n'])[0] == [1_000_000_000]


@pytest.mark.parametrize('size', [1000, 7])
def test_a_line_that_is_too_long_is_no_value_however_it_comes(size):
    text = b'\n' + b'0' * 300 + b'12\n34\n'
    pieces = [text[k : k + size] for k in range(0, len(text), size)]
    assert decode(LineDecoder(r'(\d+)'), pieces)[0] == [34]


@settings(max_examples=60)
@given(
    st.lists(
        st.one_of(
            st.integers(-9_999_999, 9_999_999).map(lambda n: b'S%+08d\r\n' % n),
            st.binary(max_size=20),
            st.just(b'x' * 300),
        ),
        max_size=30,
    ),
    st.lists(st.integers(0, 800), max_size=10),
)
def test_however_the_bytes_are_cut_the_same_comes_out(lines, cuts):
    stream = b''.join(lines)
    cuts = sorted(min(cut, len(stream)) for cut in cuts)
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    single = [stream[i : i + 1] for i in range(len(stream))]
    results = [
        (decode(decoder := LineDecoder(PATTERN), way), decoder.bad_frames)
        for way in ([stream], pieces, single)
    ]
    assert results[0] == results[1] == results[2]


def test_a_pattern_that_cannot_be_used_is_refused():
    with pytest.raises(ValueError, match=r'has no group for the number'):
        LineDecoder(r'S\d+')
    with pytest.raises(ValueError, match=r'pattern: .*missing \)'):
        LineDecoder(r'S(\d+')
