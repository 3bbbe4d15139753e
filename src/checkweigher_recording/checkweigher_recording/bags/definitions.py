# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Message definitions of bags, and conversion between records and CDR messages."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from checkweigher_core.records import NANOSECONDS, newer_fields
from checkweigher_core.ros import conversion
from checkweigher_core.ros.ports import RECORDED, Port

TIME, HEADER = 'builtin_interfaces/msg/Time', 'std_msgs/msg/Header'
_STORE = get_typestore(Stores.EMPTY)


class BagError(ValueError):
    """Raised if a bag cannot be used.

    The message states the fault, and the bag, file, message type or topic that has it.
    """


@contextmanager
def bag_errors(path: Path) -> Iterator[None]:
    """Convert exceptions to `BagError` while the bag or file `path` is read.

    A `BagError` is raised unchanged.
    """
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        where = error.filename or path
        raise BagError(f'{where}: cannot be read: {error.strerror or error}') from error
    # The parsers may raise any exception for damaged bytes, so all exceptions are converted.
    except Exception as error:
        text = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
        raise BagError(f'{path}: damaged: {text}; record it again or restore it') from error


def typestore(ports: Iterable[Port] = RECORDED) -> Typestore:
    """Return a type store that contains the installed message definitions of some ports.

    All calls return the same store. A definition is read from its package when it is needed for the
    first time.

    Raises `BagError` if the package of a definition is not installed, or its file cannot be read.
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
    """Return the CDR message of a record.

    If the record has no time stamp, the header of the message gets the time `stamp` in ns.
    """
    store = typestore([port])
    fields = conversion.to_fields(record, stamp)
    # The field frame_id stays empty, because the topic already identifies the source.
    header = store.types[HEADER](store.types[TIME](**fields.pop('header')['stamp']), '')
    times = {
        name: store.types[TIME](**value) for name, value in fields.items() if type(value) is dict
    }
    message = store.types[port.message_type](**fields | times, header=header)
    return bytes(store.serialize_cdr(message, port.message_type, little_endian=True))


def deserialize(port: Port, data: bytes, store: Typestore | None = None) -> Any:
    """Return the record that a CDR message of a port contains.

    `store` contains the definition of the message. By default, the installed definition is used.

    Raises `ValueError` if the message contains an invalid value. If `data` is not a message of the
    port, the parser may raise any exception.
    """
    message: Any = (store or typestore([port])).deserialize_cdr(data, port.message_type)
    stamp = message.header.stamp
    if stamp.sec < 0 or stamp.nanosec >= NANOSECONDS:
        raise ValueError(f'{port.name}: the stamp {stamp.sec} s, {stamp.nanosec} ns is not valid')
    return conversion.to_record(port, message)


def check_definition(path: Path, connection: Connection, port: Port) -> None:
    """Raise `BagError` unless a connection has the message type and the definition of `port`.

    A definition or hash that is missing in the bag is not compared.
    """
    if connection.msgtype != port.message_type:
        raise BagError(
            f'{path}: topic {connection.topic} holds {connection.msgtype}, but must hold '
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
    """Return the definitions to use for the messages of a connection.

    The definitions in the bag are returned if they differ from the installed ones only because
    they lack fields that a later version of the program has added. Otherwise, the installed
    definitions are returned.

    Raises `BagError` if the definitions differ in any other way.
    """
    if connection.msgtype == port.message_type:
        stored = _stored(connection.msgdef, port)
        if stored is not None and _lacks_only_newer_fields(stored, port):
            return stored
    check_definition(path, connection, port)
    return typestore([port])


def _lacks_only_newer_fields(stored: Typestore, port: Port) -> bool:
    assert port.record is not None
    there = list(stored.fielddefs[port.message_type][1])
    here = list(typestore([port]).fielddefs[port.message_type][1])
    newer = newer_fields(port.record)
    return there != here and there == [
        field for field in here if field in there or field[0] not in newer
    ]


def _type_hash(definition: MessageDefinition, port: Port) -> str:
    """Return the RIHS01 hash of a definition from a bag, or '' if its format is not MSG or IDL."""
    known = typestore([port])
    if definition.data == known.generate_msgdef(port.message_type, ros_version=2)[0]:
        return known.hash_rihs01(port.message_type)
    store = _stored(definition, port)
    return store.hash_rihs01(port.message_type) if store else ''


def _stored(definition: MessageDefinition, port: Port) -> Typestore | None:
    """Return a store with a definition from a bag.

    Returns None if the bag has no definition, or if the format of the definition is not MSG or IDL.
    """
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, port.message_type))
    elif definition.format == MessageDefinitionFormat.IDL:
        store.register(get_types_from_idl(definition.data))
    else:
        return None
    return store
