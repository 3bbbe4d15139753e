# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Definitions of the messages in bags."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros import conversion
from checkweigher_core.ros.ports import RECORDED, Port

TIME, HEADER = 'builtin_interfaces/msg/Time', 'std_msgs/msg/Header'
_STORE = get_typestore(Stores.EMPTY)


class BagError(ValueError):
    """A bag that cannot be used. The message names the bag, the fault and a remedy."""


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Convert exceptions of the libraries that read a bag or one of its files to `BagError`."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        where = error.filename or path
        raise BagError(f'{where}: cannot be read: {error.strerror or error}') from error
    # A parser may raise any exception for damaged bytes.
    except Exception as error:
        text = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
        raise BagError(f'{path}: damaged: {text}; record it again or restore it') from error


def typestore(ports: Iterable[Port] = RECORDED) -> Typestore:
    """Return the definitions of the messages of some ports and of their parts.

    They are read from the installed packages, so that a bag and the graph have the same types. Only
    the definitions of these ports are read, because reading takes time.

    Raises `BagError` if a package with messages is not installed.
    """
    for port in ports:
        _register(port.message_type)
    return _STORE


def _register(message_type: str) -> None:
    if message_type in _STORE.fielddefs:
        return
    package, folder, name = message_type.split('/')
    try:
        share = get_package_share_directory(package)
        text = Path(share, folder, f'{name}.msg').read_text(encoding='utf-8')
    except (PackageNotFoundError, OSError):
        raise BagError(
            f'{message_type}: its definition is not installed; build the workspace and source its '
            'environment'
        ) from None
    types = get_types_from_msg(text, message_type)
    for _, fields in types.values():
        for _, field in fields:
            for part in _parts(field):
                _register(part)
    _STORE.register(types)


def _parts(field: Any) -> Iterator[str]:
    kind, content = field
    if kind == Nodetype.NAME:
        yield content
    elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        yield from _parts(content[0])


def serialize(port: Port, record: Any, stamp: int) -> bytes:
    """Return the CDR message of a record of a port.

    `stamp`, in ns, is used for the header if the record has no stamp.
    """
    store = typestore([port])
    fields = conversion.to_fields(record, stamp)
    # The frame_id is empty, because it follows from the topic.
    header = store.types[HEADER](store.types[TIME](**fields.pop('header')['stamp']), '')
    times = {
        name: store.types[TIME](**value) for name, value in fields.items() if type(value) is dict
    }
    message = store.types[port.message_type](**fields | times, header=header)
    return bytes(store.serialize_cdr(message, port.message_type, little_endian=True))


def deserialize(port: Port, data: bytes, store: Typestore | None = None) -> Any:
    """Return the record of a CDR message, by the definitions of `store` or the installed ones.

    Raises an exception if the bytes are not such a message, or a value is not valid.
    """
    message: Any = (store or typestore([port])).deserialize_cdr(data, port.message_type)
    stamp = message.header.stamp
    if stamp.sec < 0 or stamp.nanosec >= NANOSECONDS:
        raise ValueError(f'{port.name}: a stamp of {stamp.sec} s and {stamp.nanosec} ns')
    return conversion.to_record(port, message)


def check_definition(path: Path, connection: Connection, port: Port) -> None:
    """Raise `BagError` unless a connection has the type and the definition of a port."""
    if connection.msgtype != port.message_type:
        raise BagError(
            f'{path}: topic {connection.topic} holds {connection.msgtype}, must hold '
            f'{port.message_type}'
        )
    here = typestore([port]).hash_rihs01(port.message_type)
    for there in (connection.digest, _type_hash(connection.msgdef, port)):
        if there and there != here:
            raise BagError(
                f'{path}: topic {connection.topic} was recorded with another definition of '
                f'{port.message_type} ({there}, here {here}); use the version that recorded it'
            )


def definitions_of(path: Path, connection: Connection, port: Port) -> Typestore:
    """Return the definitions for reading the messages of a connection.

    These are the installed definitions, or those in an older bag that lacks only newer fields.
    Raises `BagError` if the definitions differ in any other way.
    """
    if connection.msgtype == port.message_type:
        own = _brought(connection.msgdef, port)
        if own is not None and _lacks_newer(own, port):
            return own
    check_definition(path, connection, port)
    return typestore([port])


def _lacks_newer(own: Typestore, port: Port) -> bool:
    """Return whether a definition differs only in newer fields, which it lacks."""
    assert port.record is not None
    there = list(own.fielddefs[port.message_type][1])
    here = list(typestore([port]).fielddefs[port.message_type][1])
    newer = conversion.newer_fields(port.record)
    return there != here and there == [
        field for field in here if field in there or field[0] not in newer
    ]


def _type_hash(definition: MessageDefinition, port: Port) -> str:
    """Return the hash of the definition in a bag, empty if there is none."""
    known = typestore([port])
    if definition.data == known.generate_msgdef(port.message_type, ros_version=2)[0]:
        return known.hash_rihs01(port.message_type)
    store = _brought(definition, port)
    return store.hash_rihs01(port.message_type) if store else ''


def _brought(definition: MessageDefinition, port: Port) -> Typestore | None:
    """Return the definitions in a bag, None if there are none."""
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, port.message_type))
    elif definition.format == MessageDefinitionFormat.IDL:
        store.register(get_types_from_idl(definition.data))
    else:
        return None
    return store
