"""Records to messages and back, derived from the fields of the record.

Reading takes any object with the fields of the message, so that the same functions serve rclpy and
readers of bags. Writing converts every field to the exact Python type: rclpy does not check, and
a numpy scalar in a field aborts the process when the message is serialised.
"""

import array
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from functools import cache, partial
from operator import attrgetter
from typing import Any, cast, get_args, get_origin, get_type_hints

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
        for name, value in FORMS[port.record].absent.items():
            setattr(message, name, value)
        return message
    return _filled(message, record, stamp)


def to_fields(record: Any, stamp: int | None = None) -> dict[str, Any]:
    """Return the fields of a record's message by name, for a library other than rclpy.

    Header and times are mappings, arrays of the type of the message and contiguous; all else is of
    plain Python types. A record of records has no such fields.
    """
    plan = _plan(cast(Any, type(record)))
    sec, nanosec = _time(plan.stamp(record) if plan.stamp else stamp)
    fields: dict[str, Any] = {
        'header': {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': plan.frame(record)}
    }
    for place, get in plan.times:
        sec, nanosec = _time(get(record))
        fields[place] = {'sec': sec, 'nanosec': nanosec}
    for place, get, dtype in plan.arrays:
        fields[place] = np.ascontiguousarray(get(record), dtype)
    for place, get, convert in plan.others:
        fields[place] = convert(get(record))
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
    record = kind(*[convert(get(message)) for get, convert in _plan(kind).read])
    return record if form.amend is None else form.amend(message, record)


def _filled(message: Any, record: Any, stamp: int | None = None) -> Any:
    """Fill in an empty message: one that is made of parts makes them all twice."""
    plan = _plan(cast(Any, type(record)))
    header = message.header
    header.frame_id = plan.frame(record)
    header.stamp.sec, header.stamp.nanosec = _time(plan.stamp(record) if plan.stamp else stamp)
    for place, get in plan.times:
        time = getattr(message, place)
        time.sec, time.nanosec = _time(get(record))
    for place, get, dtype in plan.arrays:  # an ndarray would take twenty times as long
        values = np.ascontiguousarray(get(record), dtype)
        setattr(message, place, array.array(dtype.char, values.tobytes()))
    for place, get, convert in plan.others:
        setattr(message, place, convert(get(record)))
    return message


_Get = Callable[[Any], Any]


@dataclass(slots=True)
class _Plan:
    """Conversion of a class of records, field by field.

    Attributes
    ----------
    stamp : callable or None
        Stamp of the header, from the record; None where the caller gives it.
    frame : callable
        Frame of the header, from the record.
    times, arrays, others : list
        Name in the message and how to get the value from the record; for arrays the type of the
        elements, for others what converts the value.
    read : list
        How to get the value from the message, and what converts it, in the order of the record.
    """

    stamp: _Get | None
    frame: _Get
    times: list[tuple[str, _Get]] = field(default_factory=list)
    arrays: list[tuple[str, _Get, np.dtype[Any]]] = field(default_factory=list)
    others: list[tuple[str, _Get, _Get]] = field(default_factory=list)
    read: list[tuple[_Get, _Get]] = field(default_factory=list)


@cache
def _plan(kind: Any) -> _Plan:
    form, frame = FORMS[kind], FORMS[kind].frame
    plan = _Plan(
        attrgetter(form.stamp) if form.stamp else None,
        (lambda _: frame) if isinstance(frame, str) else frame,
    )
    names = {form.stamp: 'header.stamp', **form.names}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name in form.lacks:
            continue
        place, get = names.get(name, name), attrgetter(name)
        plan.read.append((attrgetter(place), _reader(hint, form.unknown.get(name))))
        if place == 'header.stamp':
            continue
        if hint in (Stamp, Stamp | None):
            plan.times.append((place, get))
        elif get_origin(hint) is np.ndarray:
            plan.arrays.append((place, get, _dtype(hint)))
        else:
            plan.others.append((place, get, _writer(hint)))
    plan.others += [(place, derive, lambda value: value) for place, derive in form.derived.items()]
    return plan


def _writer(hint: Any) -> Callable[[Any], Any]:
    """Return what converts a value of this type for a message."""
    if get_origin(hint) is tuple:
        kind = get_args(hint)[0]
        if kind in FORMS:
            return lambda records: [_nested(each) for each in records]
        return lambda values: list(map(kind, values))
    for plain in (bool, int, float, str):
        if issubclass(hint, plain):
            return plain
    raise TypeError(f'{hint}: no message has such a field')


def _nested(record: Any) -> Any:
    return _filled(message_class(FORMS[type(record)].message_type)(), record)


def _reader(hint: Any, unknown: Any) -> Callable[[Any], Any]:
    """Return what makes a value of this type of the field of a message."""
    if hint == Stamp:
        return stamp_from
    if hint == Stamp | None:
        return _known_stamp
    if get_origin(hint) is np.ndarray:
        return partial(_shared, dtype=_dtype(hint))
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


def _time(stamp: int | None) -> tuple[int, int]:
    """Return a stamp in ns as s and ns, 0 if it is not known or no time message can hold it."""
    sec, nanosec = divmod(int(stamp or 0), NANOSECONDS)
    # An edge may come with a stamp past 2038, and even a good one can put reject_at there.
    return (sec, nanosec) if -(2**31) <= sec < 2**31 else (0, 0)


def stamp_from(time: Any) -> int:
    """Return a time message in ns."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def _known_stamp(time: Any) -> int | None:
    """Return a time message in ns, None for the 0 that means that it is not known."""
    return stamp_from(time) or None


def _dtype(hint: Any) -> np.dtype[Any]:
    """Return the type of the elements of an ``NDArray`` type."""
    return np.dtype(get_args(get_args(hint)[1])[0])


def _shared(field: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the values of a field, not to be written to: other nodes may have the same message."""
    values: NDArray[Any] = np.frombuffer(field, dtype)
    values.flags.writeable = False
    return values
