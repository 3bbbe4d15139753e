# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Payloads and topics of Sparkplug B 3.0.

The payload is the message Payload in sparkplug_b.proto of Eclipse Tahu. This module builds the
descriptor of the message, with the fields that the gateway uses.
"""

from collections.abc import Mapping
import math
import re
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

NAMESPACE = 'spBv1.0'
BD_SEQ, REBIRTH = 'bdSeq', 'Node Control/Rebirth'
NUMBERS = 256  # seq and bdSeq are counted modulo this number

_OPTIONAL, _REPEATED = 1, 3
_DOUBLE, _UINT64, _BOOL, _STRING, _MESSAGE, _UINT32, _FLOAT = 1, 4, 8, 9, 11, 13, 2
_PAYLOAD = (('timestamp', 1, _UINT64), ('metrics', 2, _MESSAGE), ('seq', 3, _UINT64))
_METRIC = (
    ('name', 1, _STRING),
    ('timestamp', 3, _UINT64),
    ('datatype', 4, _UINT32),
    ('is_historical', 5, _BOOL),
    ('is_null', 7, _BOOL),
)
_VALUES = (
    ('int_value', 10, _UINT32),
    ('long_value', 11, _UINT64),
    ('float_value', 12, _FLOAT),
    ('double_value', 13, _DOUBLE),
    ('boolean_value', 14, _BOOL),
    ('string_value', 15, _STRING),
)
# Code of the Sparkplug data type, and name of the metric field for the value, by Python type.
_TYPES: dict[type, tuple[int, str]] = {
    bool: (11, 'boolean_value'),
    int: (4, 'long_value'),
    float: (10, 'double_value'),
    str: (12, 'string_value'),
}


def _payload_class() -> Any:
    file = descriptor_pb2.FileDescriptorProto(
        name='checkweigher/sparkplug_b.proto', package='org.eclipse.tahu.protobuf', syntax='proto2'
    )
    payload = file.message_type.add(name='Payload')
    metric = payload.nested_type.add(name='Metric')
    metric.oneof_decl.add(name='value')
    for name, number, kind in _PAYLOAD:
        field = payload.field.add(name=name, number=number, type=kind, label=_OPTIONAL)
        if kind == _MESSAGE:
            field.label, field.type_name = _REPEATED, '.org.eclipse.tahu.protobuf.Payload.Metric'
    for name, number, kind in (*_METRIC, *_VALUES):
        field = metric.field.add(name=name, number=number, type=kind, label=_OPTIONAL)
        if number >= _VALUES[0][1]:
            field.oneof_index = 0
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return message_factory.GetMessageClass(
        pool.FindMessageTypeByName('org.eclipse.tahu.protobuf.Payload')
    )


Payload: Any = _payload_class()


def encode(
    metrics: Mapping[str, object],
    stamp: int,
    seq: int | None = None,
    *,
    at: int | None = None,
    historical: bool = False,
) -> bytes:
    """Return the Sparkplug B payload of a message as bytes.

    Parameters
    ----------
    metrics : mapping
        Values by metric name. NaN is encoded as null.
    stamp : int
        Time of the message in ms since 1970. Hosts ignore messages older than the birth message.
    seq : int, optional
        Sequence number from 0 to 255, or None for an NDEATH.
    at : int, optional
        Time of the values in ms since 1970, `stamp` by default.
    historical : bool
        Whether the values precede the birth message.
    """
    payload = Payload(timestamp=stamp)
    if seq is not None:
        payload.seq = seq
    for name, value in metrics.items():
        datatype, field = _TYPES[type(value)]
        metric = payload.metrics.add(
            name=name, timestamp=stamp if at is None else at, datatype=datatype
        )
        if historical:
            metric.is_historical = True
        if isinstance(value, float) and math.isnan(value):
            metric.is_null = True
        else:
            setattr(metric, field, value)
    return bytes(payload.SerializeToString())


def decode(data: bytes | bytearray) -> dict[str, Any]:
    """Return the values of a payload by metric name, None for null.

    Raises ValueError if the data are not a Sparkplug B payload.
    """
    payload = Payload()
    try:
        payload.ParseFromString(bytes(data))
    # Catch all exceptions, because the base class of DecodeError depends on the protobuf backend.
    except Exception as error:
        raise ValueError(f'not a Sparkplug B payload: {error}') from None
    return {
        metric.name: getattr(metric, kind) if (kind := metric.WhichOneof('value')) else None
        for metric in payload.metrics
    }


def element(text: str) -> str:
    """Return a text as a topic level.

    Dots replace ``/``, ``+``, ``#`` and NUL. An empty text, such as the name of a lane without a
    namespace, is replaced by ``lane``.
    """
    return re.sub(r'[/+#\0]', '.', text) or 'lane'


class EdgeNode:
    """Topics and sequence numbers of an edge node during one connection."""

    def __init__(self, group: str, node: str, bd_seq: int) -> None:
        self._group, self._node = element(group), element(node)
        self._bd_seq, self._seq = bd_seq, 0

    def topic(self, kind: str, device: str = '') -> str:
        """Return the topic of a kind of message, such as NBIRTH.

        `device` is the topic level of a device, or empty for a message on the edge node itself.
        """
        return '/'.join(filter(None, (NAMESPACE, self._group, kind, self._node, device)))

    def death(self, stamp: int) -> tuple[str, bytes]:
        """Return topic and payload of the NDEATH, which is the will of the connection."""
        return self.topic('NDEATH'), encode({BD_SEQ: self._bd_seq}, stamp)

    def birth(self, metrics: Mapping[str, object], stamp: int) -> tuple[str, bytes]:
        """Return topic and payload of the NBIRTH, and restart the sequence numbers at 0."""
        self._seq = 0
        own = {BD_SEQ: self._bd_seq, REBIRTH: False, **metrics}
        return self.topic('NBIRTH'), encode(own, stamp, 0)

    def message(
        self,
        kind: str,
        device: str,
        metrics: Mapping[str, object],
        stamp: int,
        *,
        at: int | None = None,
        historical: bool = False,
    ) -> tuple[str, bytes]:
        """Return topic and payload of a DBIRTH, DDATA or DDEATH, with the next sequence number."""
        self._seq = (self._seq + 1) % NUMBERS
        data = encode(metrics, stamp, self._seq, at=at, historical=historical)
        return self.topic(kind, element(device)), data
