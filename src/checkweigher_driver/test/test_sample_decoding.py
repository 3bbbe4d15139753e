"""The decoder of samples against that of rosbags."""

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_driver.bag_messages import HEADER, SAMPLES, TIME, typestore
from checkweigher_driver.sample_decoding import sample_block_from
from checkweigher_dsp.records import NANOSECONDS


def _message(sec=5, nanosec=7, frame_id='load_cell', first_index=3, counts=(1, -2, 3)):
    types = typestore().types
    return types[SAMPLES.message_type](
        types[HEADER](types[TIME](sec, nanosec), frame_id), first_index, np.array(counts, np.int32)
    )


def _encoded(message):
    return bytes(typestore().serialize_cdr(message, SAMPLES.message_type))


@given(
    st.integers(0, 2**31 - 1), st.integers(0, NANOSECONDS - 1), st.text(max_size=20),
    st.integers(0, 2**64 - 1), st.lists(st.integers(-(2**31), 2**31 - 1), max_size=40),
)  # fmt: skip
@example(0, 0, '', 0, [])
def test_what_was_encoded_is_decoded(sec, nanosec, frame_id, first_index, counts):
    block = sample_block_from(_encoded(_message(sec, nanosec, frame_id, first_index, counts)))

    assert (block.stamp, block.first_index) == (sec * NANOSECONDS + nanosec, first_index)
    assert block.counts.dtype == np.int32
    assert block.counts.tolist() == counts


@given(st.data())
def test_damaged_bytes_are_decoded_as_rosbags_does_or_left_to_it(data):
    encoded = bytearray(_encoded(_message()))
    for _ in range(data.draw(st.integers(1, 3))):
        encoded[data.draw(st.integers(0, len(encoded) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(encoded[: data.draw(st.integers(0, len(encoded)))])

    block = sample_block_from(cut)

    if block is not None:
        message = typestore().deserialize_cdr(cut, SAMPLES.message_type)
        stamp = message.header.stamp
        assert block.stamp == stamp.sec * NANOSECONDS + stamp.nanosec
        assert block.first_index == message.first_index
        assert block.counts.tolist() == message.counts.tolist()


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'\x00\x00\x00\x00' + _encoded(_message())[4:],
        _encoded(_message()) + b'\0',
        _encoded(_message())[:-1],
        _encoded(_message(sec=-1)),
        _encoded(_message(nanosec=NANOSECONDS)),
        _encoded(_message()).replace(b'load', b'\xff\xff\xff\xff'),
    ],
    ids=['empty', 'big endian', 'longer', 'shorter', 'before 1970', 'nanoseconds', 'no text'],
)
def test_everything_else_is_left_to_the_general_decoder(data):
    assert sample_block_from(data) is None
