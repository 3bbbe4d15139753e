"""Records to messages and back, derived from the fields of the record.

Reading takes any object with the fields of the message, so that the same functions serve rclpy and
readers of bags. Writing converts every field to the exact Python type: rclpy does not check, and
a numpy scalar in a field aborts the process when the message is serialised.
"""

import array
from collections.abc import Callable
from enum import Enum
from functools import cache
from operator import attrgetter
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.records import NANOSECONDS, Stamp
from checkweigher_dsp.ros.ports import FORMS, Port, message_class


def to_message(port: Port, record: Any, *, stamp: int | None = None) -> Any:
    """Return the message of a record for rclpy.

    Parameters
    ----------
    port : Port
        Where it goes.
    record : object
        Of the port's class. None is the message that says that there is no such record, where the
        port has one.
    stamp : int, optional
        ns, for the header, where the record has no stamp of its own.
    """
    message = port.type()
    if record is None and port.record is not None:
        return _filled(message, dict(FORMS[port.record].absent))
    return _filled(message, to_fields(record, stamp))


def to_fields(record: Any, stamp: int | None = None) -> dict[str, Any]:
    """Return the fields of a record's message by name, parts of it as such mappings.

    Arrays are of the type of the message and contiguous; all else is of plain Python types.
    """
    kind: Any = type(record)
    form = FORMS[kind]
    frame = form.frame if isinstance(form.frame, str) else form.frame(record)
    if form.stamp:
        stamp = getattr(record, form.stamp)
    fields: dict[str, Any] = {'header': {'stamp': _time(stamp), 'frame_id': frame}}
    for name, get, convert in _written(kind):
        fields[name] = convert(get(record))
    for name, derive in form.derived.items():
        fields[name] = derive(record)
    return fields


def to_record(port: Port, message: Any) -> Any:
    """Return the record of a message of rclpy or of a bag.

    Its arrays are those of the message, not to be written to: others may have the same message.
    Where the message says that there is no such record, that is None.

    Raises
    ------
    ValueError
        If a field holds what the record cannot have, such as an eye that does not exist.
    """
    assert port.record is not None, f'{port.name} has no record'
    return _record(port.record, message)


def _record(kind: Any, message: Any) -> Any:
    form = FORMS[kind]
    if form.absent and all(getattr(message, k) == value for k, value in form.absent.items()):
        return None
    values = {name: convert(get(message)) for name, get, convert in _read(kind)}
    if form.amend is not None:
        form.amend(message, values)
    return kind(**values)


def _filled(message: Any, fields: dict[str, Any]) -> Any:
    """Fill in an empty message: one that is made of parts makes them all twice."""
    for name, value in fields.items():
        kind = type(value)
        if kind is dict:
            _filled(getattr(message, name), value)
        elif kind is np.ndarray:  # twenty times slower to assign than an array
            setattr(message, name, array.array(value.dtype.char, value.tobytes()))
        else:
            setattr(message, name, value)
    return message


_Step = tuple[str, Callable[[Any], Any], Callable[[Any], Any]]


@cache
def _written(kind: type) -> tuple[_Step, ...]:
    """Return the field of the message, how to get it from a record, and how to convert it."""
    return tuple(
        (place, attrgetter(name), _writer(hint))
        for name, place, hint in _places(kind)
        if '.' not in place
    )


@cache
def _read(kind: type) -> tuple[_Step, ...]:
    """Return the field of the record, how to get it from a message, and how to convert it."""
    unknown = FORMS[kind].unknown
    return tuple(
        (name, attrgetter(place), _reader(hint, unknown.get(name)))
        for name, place, hint in _places(kind)
    )


def _places(kind: type) -> list[tuple[str, str, Any]]:
    """Return name, field of the message and type of each field of a record."""
    form = FORMS[kind]
    names = {form.stamp: 'header.stamp', **form.names}
    hints = get_type_hints(kind, include_extras=True)
    return [
        (name, names.get(name, name), hints[name])
        for name in kind.__dataclass_fields__  # type: ignore[attr-defined]
        if name not in form.lacks
    ]


def _time(stamp: int | None) -> dict[str, int]:
    """Return a stamp in ns as a time, 0 if it is not known or no time can hold it."""
    sec, nanosec = divmod(int(stamp or 0), NANOSECONDS)
    # An edge may come with a stamp past 2038, and even a good one can put reject_at there.
    in_range = -(2**31) <= sec < 2**31
    return {'sec': sec, 'nanosec': nanosec} if in_range else {'sec': 0, 'nanosec': 0}


def _stamp(time: Any) -> int:
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _known_stamp(time: Any) -> int | None:
    return _stamp(time) or None


def _dtype(hint: Any) -> type:
    """Return the type of the elements of an ``NDArray`` type."""
    kind: type = get_args(get_args(hint)[1])[0]
    return kind


def _writer(hint: Any) -> Callable[[Any], Any]:
    """Return what converts a field of this type for a message."""
    if hint in (Stamp, Stamp | None):
        return _time
    if get_origin(hint) is np.ndarray:
        dtype = _dtype(hint)
        return lambda values: np.ascontiguousarray(values, dtype)
    if get_origin(hint) is tuple:
        kind = get_args(hint)[0]
        if kind in FORMS:
            return lambda records: [_ros_message(each) for each in records]
        return lambda values: list(map(kind, values))
    for plain in (bool, int, float, str):
        if issubclass(hint, plain):
            return plain
    raise TypeError(f'{hint}: no message has such a field')


def _ros_message(record: Any) -> Any:
    return _filled(message_class(FORMS[type(record)].message_type)(), to_fields(record))


def _reader(hint: Any, unknown: Any = None) -> Callable[[Any], Any]:
    """Return what converts a field of a message to this type."""
    if hint == Stamp:
        return _stamp
    if hint == Stamp | None:
        return _known_stamp
    if get_origin(hint) is np.ndarray:
        dtype = _dtype(hint)
        return lambda values: _shared(values, dtype)
    if get_origin(hint) is tuple:
        kind = get_args(hint)[0]
        if kind in FORMS:
            return lambda messages: tuple(_record(kind, each) for each in messages)
        return lambda values: tuple(map(kind, values))
    if issubclass(hint, Enum) and unknown is not None:
        members = {member.value: member for member in hint}
        return lambda value: members.get(value, unknown)
    reader: Callable[[Any], Any] = hint
    return reader


def _shared(field: Any, kind: type) -> NDArray[Any]:
    """Return the values of a field, not to be written to: other nodes may have the same message."""
    values: NDArray[Any] = np.frombuffer(field, kind)
    values.flags.writeable = False
    return values


def __getattr__(name: str) -> Any:
    """Return a function for one record alone, until no caller of these is left."""
    from checkweigher_dsp.ros import named_conversion

    return getattr(named_conversion, name)
