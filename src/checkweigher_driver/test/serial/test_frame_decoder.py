# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames out of streams that lose, gain and change bytes."""

from hypothesis import assume, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_driver.serial.frame_decoder import FrameDecoder

ENDS = {'crlf': b'\r\n', 'none': b''}


def frame(count: int, trailer: str, status: int | None = None) -> bytes:
    """Return a frame as the protocol has it, one value at a time."""
    data = count.to_bytes(3, 'big', signed=True)
    check = data[0] ^ data[1] ^ data[2] if status is None else status
    return data + bytes([check]) + ENDS[trailer]


def decode(decoder: FrameDecoder, pieces) -> tuple[list[int], list[int]]:
    """Return counts and the number of each value since the first, with those lost."""
    counts, indices, index = [], [], -1
    for piece in pieces:
        found = decoder.feed(piece)
        for count, lost in zip(found.counts.tolist(), found.lost.tolist(), strict=True):
            index += 1 + lost
            counts.append(count)
            indices.append(index)
    return counts, indices


def walk(seed: int, size: int, scale: float = 25.0, level: int = 1_250_000) -> list[int]:
    """Return what a load cell reads: a level and noise, no two values next to each other alike."""
    generator = np.random.default_rng(seed)
    steps = generator.choice([-1, 1], size) * (2 + generator.exponential(scale, size)).astype(int)
    return np.clip(level + np.cumsum(steps), -(2**23), 2**23 - 1).tolist()


def matched(counts: list[int], signal: list[int]) -> list[int]:
    """Return the first numbers in a signal that counts in this order can have had."""
    rest = iter(range(len(signal)))
    numbers = [next((n for n in rest if signal[n] == count), -1) for count in counts]
    assert -1 not in numbers, 'a value came that was never sent'
    return numbers


SIGNALS = st.one_of(
    st.builds(
        walk,
        seed=st.integers(0, 2**32 - 1),
        size=st.integers(60, 120),
        scale=st.sampled_from([1.0, 25.0, 3000.0]),
        # 0x0D0A0D and its like put CR LF inside the frames and where they end.
        level=st.sampled_from([1_250_000, 0, -1, 0x0D0A0D, 0x0A0D0A, 0x13140D, 0x7FFF, -(2**23)]),
    ),
    st.lists(st.integers(-(2**23), 2**23 - 1), min_size=60, max_size=100),
)


def looks_good(data: bytes, count: int) -> bool:
    """Tell whether what has become of a frame with CR LF is another one: no checksum tells."""
    return any(
        data[i] ^ data[i + 1] ^ data[i + 2] == data[i + 3]
        and data[i + 4 : i + 6] == b'\r\n'
        and data[i : i + 6] != frame(count, 'crlf')
        for i in range(len(data) - 5)
    )


@st.composite
def disturbed(draw, sizes):
    """Return a signal, the numbers of its frames that are untouched, and the bytes that come."""
    trailer = draw(st.sampled_from(sorted(sizes)))
    signal = draw(SIGNALS)
    size = sizes[trailer]
    data = [bytearray(frame(count, trailer)) for count in signal]
    touched = set()
    # Where CR LF is inside frames as well, two losses close to each other may make up a third one.
    apart = 12 if any(b'\r\n' in frame(count, 'none') for count in signal) else 1
    last = (len(signal) - 2) // apart
    for number in draw(st.lists(st.integers(0, last).map(apart.__mul__), max_size=4, unique=True)):
        kind = draw(st.sampled_from(['change', 'lose', 'junk']))
        place = draw(st.integers(0, size - 1))
        if kind == 'change':
            data[number][place] ^= draw(st.integers(1, 255))
        elif kind == 'lose':
            del data[number][place : place + draw(st.integers(1, size - 1))]
        else:
            junk = draw(st.binary(min_size=1, max_size=size - 1))
            data[number][place:place] = junk
        if frame(signal[number], trailer) not in data[number]:
            touched.add(number)
        assume(not looks_good(bytes(data[number]), signal[number]))
    stream = b''.join(data)
    cuts = sorted(draw(st.lists(st.integers(0, len(stream)), max_size=12)))
    pieces = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, len(stream)], strict=True)]
    return trailer, signal, touched, stream, pieces


@pytest.mark.parametrize('trailer', ENDS)
@pytest.mark.parametrize('mode', ['auto', 'given'])
def test_every_value_of_an_undisturbed_stream_is_found(trailer, mode):
    signal = [*walk(1, 500), *walk(2, 500, level=0x0D0A0D), 2**23 - 1, -(2**23), *walk(3, 50)]
    decoder = FrameDecoder(trailer='auto' if mode == 'auto' else trailer)
    counts, indices = decode(decoder, [b''.join(frame(c, trailer) for c in signal)])

    first = 0 if trailer == 'crlf' else 5
    assert counts == signal[first : len(signal) - decoder.waiting]
    assert indices == list(range(len(counts)))
    assert decoder.waiting == (0 if trailer == 'crlf' else 4)
    assert decoder.skipped_bytes == 4 * first
    assert decoder.bad_frames == 0
    assert decoder.frame_bytes == 4 + len(ENDS[trailer])


@settings(max_examples=40)
@given(disturbed({'crlf': 6, 'none': 4}), st.booleans())
def test_however_the_bytes_are_cut_the_same_comes_out(case, auto):
    trailer, _, _, stream, pieces = case
    mode = 'auto' if auto else trailer
    whole, cut = FrameDecoder(trailer=mode), FrameDecoder(trailer=mode)
    assert decode(whole, [stream]) == decode(cut, pieces)
    each = FrameDecoder(trailer=mode)
    assert decode(whole, []) == ([], [])
    assert decode(each, [stream[i : i + 1] for i in range(len(stream))]) == decode(
        FrameDecoder(trailer=mode), [stream]
    )
    assert (cut.skipped_bytes, cut.bad_frames) == (each.skipped_bytes, each.bad_frames)


@settings(max_examples=100)
@given(disturbed({'crlf': 6}))
def test_with_cr_lf_no_wrong_value_passes_and_five_good_frames_are_enough(case):
    trailer, signal, touched, _, pieces = case
    counts, indices = decode(FrameDecoder(trailer=trailer), pieces)

    earliest = matched(counts, signal)  # nothing but what was sent, in its order
    latest = [len(signal) - 1 - n for n in matched(counts[::-1], signal[::-1])[::-1]]
    assert len(counts) >= len(signal) - 4 * 16 - 9
    if touched & set(range(latest[0] + 1, earliest[-1])):
        assert indices[-1] + 1 > len(counts)


@settings(max_examples=100)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1.0, 25.0, 3000.0]),
    st.sampled_from([1_250_000, 0, -1, 0x7FFF, 0x12FFF0]),
    st.lists(
        st.tuples(st.integers(1, 15), st.integers(0, 3), st.integers(1, 3)),
        max_size=3,
        unique_by=lambda loss: loss[0],
    ),
)
def test_without_cr_lf_a_slipped_stream_is_never_taken_for_a_signal(seed, scale, level, losses):
    signal = walk(seed, 200, scale, level)
    data = [frame(count, 'none') for count in signal]
    for number, place, size in losses:
        data[12 * number] = data[12 * number][:place] + data[12 * number][place + size :]
    counts, indices = decode(FrameDecoder(trailer='none'), [b''.join(data)])

    matched(counts, signal)
    assert len(counts) >= len(signal) - 9 - 16 * len(losses)
    assert indices[-1] + 1 >= len(counts) + len(losses)


@pytest.mark.parametrize('place', range(4))
def test_the_checksum_alone_would_have_let_a_slip_pass(place):
    """A slow signal: read from one byte on, nearly every frame has a good checksum."""
    signal = walk(5, 400)
    data = b''.join(frame(count, 'none') for count in signal)[place:]
    rows = np.frombuffer(data[: len(data) // 4 * 4], np.uint8).reshape(-1, 4)
    passing = np.mean(rows[:, 0] ^ rows[:, 1] ^ rows[:, 2] == rows[:, 3])
    assert passing > 0.9 or place > 1

    counts, _ = decode(FrameDecoder(trailer='none'), [data])
    assert counts == signal[6 if place else 5 : -4]


@pytest.mark.parametrize('trailer', ENDS)
def test_what_a_disturbed_byte_costs_is_counted(trailer):
    signal = walk(7, 100)
    data = [bytearray(frame(count, trailer)) for count in signal]
    data[50][1] ^= 0x40
    decoder = FrameDecoder(trailer=trailer)
    counts, indices = decode(decoder, [b''.join(data)])

    # Without CR LF those that wait for it as well, and the first ones when it begins again.
    begin, last, again = (0, 49, 51) if trailer == 'crlf' else (5, 45, 56)
    size = len(data[0])
    assert counts == signal[begin : last + 1] + signal[again : len(signal) - decoder.waiting]
    assert indices[last - begin : last - begin + 2] == [last - begin, again - begin]
    assert decoder.bad_frames == 1
    assert decoder.skipped_bytes == (again - last - 1 + begin) * size


def test_lost_bytes_count_as_the_frames_that_they_were_part_of():
    signal = walk(8, 100)
    data = [frame(count, 'crlf') for count in signal]
    data[30] = data[30][:2]
    data[31] = data[31][5:]
    counts, indices = decode(FrameDecoder(trailer='crlf'), [b''.join(data)])

    assert counts == signal[:30] + signal[32:]
    # 9 of 12 bytes are gone, the 3 that are left are of at least one frame.
    assert indices[29:31] == [29, 31]


def test_the_status_byte_tells_of_an_overflow():
    statuses = [0, 0b1000, 0b0001, 0b0010, 0b0100, 0b0011_1000]
    data = b''.join(frame(1000 + i, 'crlf', status) for i, status in enumerate(statuses))
    found = FrameDecoder(checksum=False).feed(data)

    assert found.counts.tolist() == [1000 + i for i in range(6)]
    assert found.overflow.tolist() == [False, False, True, True, True, False]


def test_without_checksum_a_frame_that_is_not_one_is_still_passed_over():
    data = b''.join(frame(1000 + i, 'crlf', 0) for i in range(20))
    decoder = FrameDecoder(checksum=False)
    counts, _ = decode(decoder, [data[:33] + data[34:]])

    assert counts == [1000 + i for i in range(20) if i != 5]
    assert decoder.skipped_bytes == 5


def test_a_signal_that_stands_still_is_waited_for():
    """Nothing tells where its frames begin, as long as it does not change."""
    decoder = FrameDecoder(trailer='none')
    data = b''.join(frame(1_250_123, 'none') for _ in range(50))
    assert decode(decoder, [data[1:]]) == ([], [])
    after = walk(3, 20)
    counts, _ = decode(decoder, [b''.join(frame(count, 'none') for count in after)])
    assert len(counts) >= 14
    assert counts == after[16 - len(counts) : 16]


def test_junk_gives_no_values():
    junk = np.random.default_rng(4).integers(0, 256, 200_000, dtype=np.uint8).tobytes()
    for mode in ('crlf', 'none'):
        decoder = FrameDecoder(trailer=mode)
        assert decode(decoder, [junk[i : i + 500] for i in range(0, len(junk), 500)])[0] == []
        assert decoder.skipped_bytes > len(junk) - 30
