# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Payloads and topics of Sparkplug B."""

import math

import pytest

from checkweigher_gateways.sparkplug import EdgeNode, decode, element, encode

# By hand from sparkplug_b.proto of Eclipse Tahu: tag (field number * 8 + wire type) and value.
STAMP = bytes.fromhex('08 01')  # timestamp = 1
METRIC_STAMP = bytes.fromhex('18 01')


def metric(name: bytes, datatype: int, value: bytes) -> bytes:
    body = bytes([0x0A, len(name)]) + name + METRIC_STAMP + bytes([0x20, datatype]) + value
    return bytes([0x12, len(body)]) + body


@pytest.mark.parametrize(
    ('value', 'datatype', 'wire'),
    [
        (3, 4, '58 03'),  # Int64, long_value = 11
        (0.5, 10, '69 00 00 00 00 00 00 e0 3f'),  # Double, double_value = 13
        (True, 11, '70 01'),  # Boolean, boolean_value = 14
        ('ab', 12, '7a 02 61 62'),  # String, string_value = 15
        (math.nan, 10, '38 01'),  # is_null = 7
    ],
)
def test_a_payload_is_that_of_the_specification(value: object, datatype: int, wire: str):
    data = encode({'m': value}, 1, 7)
    assert data == STAMP + metric(b'm', datatype, bytes.fromhex(wire)) + bytes.fromhex('18 07')
    (found,) = decode(data).values()
    assert found == value or (found is None and math.isnan(float(str(value))))


def test_values_of_before_the_birth_are_marked():
    data = encode({'m': True}, 2, at=1, historical=True)
    # A later timestamp of the message, is_historical = 5, and no sequence number
    assert data == bytes.fromhex('08 02') + metric(b'm', 11, bytes.fromhex('28 01 70 01'))


def test_what_is_no_payload_is_refused():
    with pytest.raises(ValueError, match='not a Sparkplug B payload'):
        decode(b'\xff\xff')


def test_topics_and_numbers_are_those_of_the_specification():
    node = EdgeNode('Werk/1', 'host', 9)
    topic, data = node.death(1)
    assert topic == 'spBv1.0/Werk.1/NDEATH/host'
    assert decode(data) == {'bdSeq': 9}
    topic, data = node.birth({}, 1)
    assert topic == 'spBv1.0/Werk.1/NBIRTH/host'
    assert decode(data) == {'bdSeq': 9, 'Node Control/Rebirth': False}
    assert data.endswith(bytes.fromhex('18 00'))  # seq = 0
    sent = [node.message('DDATA', 'hall/lane1', {}, 1) for _ in range(257)]
    assert sent[0] == ('spBv1.0/Werk.1/DDATA/host/hall.lane1', STAMP + bytes.fromhex('18 01'))
    assert sent[255][1].endswith(bytes.fromhex('18 00'))
    assert sent[256][1].endswith(bytes.fromhex('18 01'))
    assert element('') == 'lane'
