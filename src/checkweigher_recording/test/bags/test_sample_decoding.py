# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Blocks that are decoded many at once against the same blocks as rosbags decodes each."""

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.ports import LOAD_CELL_SAMPLES
from checkweigher_recording.bags.definitions import HEADER, TIME, deserialize, typestore
from checkweigher_recording.bags.sample_decoding import decode_samples

MESSAGE_TYPE = LOAD_CELL_SAMPLES.message_type


def encoded(
    sec=5, nanosec=7, frame_id='load_cell', first_index=3, counts=(1, -2, 3), *, little_endian=True
):
    types = typestore().types
    header = types[HEADER](types[TIME](sec, nanosec), frame_id)
    message = types[MESSAGE_TYPE](header, first_index, np.array(counts, np.int32))
    return bytes(typestore().serialize_cdr(message, MESSAGE_TYPE, little_endian=little_endian))


def listed(blocks):
    assert all(block.counts.dtype == np.int32 for block in blocks)
    return [(block.stamp, block.first_index, block.counts.tolist()) for block in blocks]


def decoded(messages):
    return listed(decode_samples(messages))


def one_by_one(messages):
    return listed([deserialize(LOAD_CELL_SAMPLES, message) for message in messages])


def outcome(decode, messages):
    try:
        return decode(messages)
    except Exception:
        return 'refused'


@given(
    st.integers(0, 2**31 - 1), st.integers(0, NANOSECONDS - 1), st.text(max_size=20),
    st.integers(0, 2**64 - 1), st.lists(st.integers(-(2**31), 2**31 - 1), max_size=40),
)  # fmt: skip
@example(0, 0, '', 0, [])
def test_an_encoded_block_is_decoded(sec, nanosec, frame_id, first_index, counts):
    message = encoded(sec, nanosec, frame_id, first_index, counts)

    assert decoded([message]) == [(sec * NANOSECONDS + nanosec, first_index, counts)]


@given(st.data())
def test_many_blocks_are_decoded_in_their_order(data):
    messages = data.draw(
        st.lists(
            st.builds(
                encoded, st.integers(0, 9), st.integers(0, NANOSECONDS - 1),
                st.sampled_from(['cell', 'load_cell', 'Zelle']), st.integers(0, 2**64 - 1),
                st.lists(st.integers(-(2**31), 2**31 - 1), max_size=3),
                little_endian=st.sampled_from([True, True, True, False]),
            ),
            max_size=30,
        )
    )  # fmt: skip
    assert decoded(messages) == one_by_one(messages)


@given(st.data())
def test_damaged_blocks_among_whole_ones_are_decoded_or_refused_as_by_rosbags(data):
    messages = [bytearray(encoded(first_index=number)) for number in range(5)]
    for _ in range(data.draw(st.integers(1, 3))):
        message = messages[data.draw(st.integers(0, 4))]
        message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, 4))
    messages[cut] = messages[cut][: data.draw(st.integers(0, len(messages[cut])))]
    messages = [bytes(message) for message in messages]

    assert outcome(decoded, messages) == outcome(one_by_one, messages)


@pytest.mark.parametrize(
    'wrong',
    [
        b'',
        encoded()[:-1],
        encoded(sec=-1),
        encoded(nanosec=NANOSECONDS),
        encoded().replace(b'load', b'\xff\xff\xff\xff'),
    ],
    ids=['empty', 'shorter', 'before 1970', 'nanoseconds', 'no text'],
)
@pytest.mark.parametrize('place', [0, 2])
def test_a_block_that_is_not_valid_is_refused(wrong, place):
    messages = [encoded(first_index=number) for number in range(4)]
    messages[place] = wrong

    assert outcome(decoded, messages) == 'refused'
