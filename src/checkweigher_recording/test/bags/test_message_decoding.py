"""The decoders of samples and edges against that of rosbags."""

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_recording.bags.message_decoding import (
    SampleDecoder,
    eye_edge_from,
    sample_block_from,
)
from checkweigher_recording.bags.messages import HEADER, PHOTO_EYES, SAMPLES, TIME, typestore


def _message(sec=5, nanosec=7, frame_id='load_cell', first_index=3, counts=(1, -2, 3)):
    types = typestore().types
    return types[SAMPLES.message_type](
        types[HEADER](types[TIME](sec, nanosec), frame_id), first_index, np.array(counts, np.int32)
    )


def _encoded(message):
    return bytes(typestore().serialize_cdr(message, SAMPLES.message_type))


def _decoded(data):
    """Return what rosbags makes of a message."""
    message = typestore().deserialize_cdr(data, SAMPLES.message_type)
    stamp = message.header.stamp
    if stamp.nanosec >= NANOSECONDS:
        raise ValueError(f'a stamp of {stamp.nanosec} ns')
    return SampleBlock(stamp.sec * NANOSECONDS + stamp.nanosec, message.first_index, message.counts)


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


@given(st.data())
def test_many_are_decoded_as_one_by_one(data):
    plain = st.builds(
        _message, st.integers(0, 9), st.integers(0, NANOSECONDS - 1),
        st.sampled_from(['cell', 'load_cell', 'Zelle']), st.integers(0, 2**64 - 1),
        st.lists(st.integers(-(2**31), 2**31 - 1), max_size=3),
    )  # fmt: skip
    messages = [_encoded(message) for message in data.draw(st.lists(plain, max_size=30))]
    store = typestore()
    for number in data.draw(st.lists(st.integers(0, 29), max_size=5)):
        if number < len(messages):
            decoded = store.deserialize_cdr(messages[number], SAMPLES.message_type)
            messages[number] = bytes(
                store.serialize_cdr(decoded, SAMPLES.message_type, little_endian=False)
            )

    decoder = SampleDecoder(_decoded)
    for number, message in enumerate(messages):
        decoder.add([message])
        if number % 7 == 6:
            decoder.flush()

    found = [(b.stamp, b.first_index, b.counts.tolist()) for b in decoder.blocks()]
    expected = [_decoded(message) for message in messages]
    assert found == [(b.stamp, b.first_index, b.counts.tolist()) for b in expected]


def test_of_several_messages_that_say_nothing_the_first_one_is_reported():
    wrong = [_message(nanosec=NANOSECONDS + 1), _message(counts=()), _message(nanosec=NANOSECONDS)]
    decoder = SampleDecoder(_decoded)
    for message in (_message(), *wrong):
        decoder.add([_encoded(message)])

    with pytest.raises(ValueError, match='1000000001 ns'):
        decoder.flush()


@given(st.data())
def test_damaged_among_whole_ones_are_decoded_as_alone(data):
    messages = [bytearray(_encoded(_message(first_index=n))) for n in range(5)]
    for _ in range(data.draw(st.integers(1, 3))):
        message = messages[data.draw(st.integers(0, 4))]
        message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    left: list[bytes] = []

    def leave(message):
        left.append(message)
        return SampleBlock(0, 0, np.zeros(0, np.int32))

    decoder = SampleDecoder(leave)
    for message in messages:
        decoder.add([bytes(message)])
    blocks = decoder.blocks()

    alone = [sample_block_from(bytes(message)) for message in messages]
    assert left == [m for m, block in zip(messages, alone, strict=True) if block is None]
    for block, expected in zip(blocks, alone, strict=True):
        if expected is not None:
            assert (block.stamp, block.first_index) == (expected.stamp, expected.first_index)
            assert block.counts.tolist() == expected.counts.tolist()


def _event(sec=5, nanosec=7, frame_id='belt', eye=1, blocked=True):
    types = typestore().types
    header = types[HEADER](types[TIME](sec, nanosec), frame_id)
    return typestore().serialize_cdr(
        types[PHOTO_EYES.message_type](header, eye, blocked), PHOTO_EYES.message_type
    )


@given(
    st.integers(0, 2**31 - 1), st.integers(0, NANOSECONDS - 1), st.text(max_size=20),
    st.sampled_from(Eye), st.booleans(),
)  # fmt: skip
def test_an_edge_that_was_encoded_is_decoded(sec, nanosec, frame_id, eye, blocked):
    edge = eye_edge_from(bytes(_event(sec, nanosec, frame_id, int(eye), blocked)))

    assert edge == EyeEdge(sec * NANOSECONDS + nanosec, eye, blocked)
    assert (type(edge.eye), type(edge.blocked)) == (Eye, bool)


@given(st.data())
def test_a_damaged_edge_is_decoded_as_rosbags_does_or_left_to_it(data):
    encoded = bytearray(_event())
    for _ in range(data.draw(st.integers(1, 3))):
        encoded[data.draw(st.integers(0, len(encoded) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(encoded[: data.draw(st.integers(0, len(encoded)))])

    edge = eye_edge_from(cut)

    if edge is not None:
        message = typestore().deserialize_cdr(cut, PHOTO_EYES.message_type)
        stamp = message.header.stamp
        assert edge.stamp == stamp.sec * NANOSECONDS + stamp.nanosec
        assert (edge.eye, edge.blocked) == (message.eye, message.blocked)


@pytest.mark.parametrize(
    'data',
    [
        b'',
        b'\x00\x00\x00\x00' + bytes(_event())[4:],
        bytes(_event()) + b'\0',
        bytes(_event())[:-1],
        bytes(_event(sec=-1)),
        bytes(_event(nanosec=NANOSECONDS)),
        bytes(_event(eye=2)),
        bytes(_event())[:-1] + b'\2',
    ],
    ids=['empty', 'big endian', 'longer', 'shorter', 'before 1970', 'nanoseconds', 'a third eye',
         'neither true nor false'],
)  # fmt: skip
def test_what_is_no_plain_edge_is_left_to_the_general_decoder(data):
    assert eye_edge_from(data) is None
