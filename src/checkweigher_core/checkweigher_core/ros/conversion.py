# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of records to messages and back, field by field except for `_FORMS`.

Any object with the fields of the message can be read, so that the same functions serve rclpy and
readers of bags. Every field is written in the exact Python type, because rclpy does not check
types, and a numpy scalar in a field aborts the process when the message is serialised.
"""

import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from functools import cache, partial
from operator import attrgetter
from typing import Any, cast, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from checkweigher_core import records
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros.ports import Port, interface


@dataclass(frozen=True)
class _Form:
    """Differences between a record and its message, which otherwise have the same fields."""

    # Field of the record that becomes the stamp of the header. The message has it only there,
    # unless `names` has it, too. Empty if the caller gives the stamp.
    stamp: str = 'stamp'
    frame: str | Callable[[Any], str] = ''  # of the header, or a function that returns it
    names: Mapping[str, str] = field(default_factory=dict)  # in the message, by name in the record
    lacks: tuple[str, ...] = ()  # last fields that no message has; read as their defaults
    newer: tuple[str, ...] = ()  # fields that older bags lack; read as their defaults
    derived: Mapping[str, Callable[[Any], object]] = field(default_factory=dict)
    # Member for an unknown value of an enumeration. Without one, the message is refused.
    unknown: Mapping[str, object] = field(default_factory=dict)
    absent: Mapping[str, object] = field(default_factory=dict)  # fields that mean: no record
    # Takes a message and the record read from it, and returns the corrected record.
    amend: Callable[[Any, Any], Any] | None = None


def _with_reason(message: Any, estimate: records.MassEstimate) -> records.MassEstimate:
    """Return an estimate, with a reason if it has no mass, as in an empty message."""
    weighed = message.status == _WEIGHED and 0 < estimate.mass <= records.MAX_MASS
    return estimate if weighed or estimate.reasons else replace(estimate, reasons=('Unknown',))


def _with_text(message: Any, request: records.StopRequest) -> records.StopRequest:
    """Return a stop request with the text that its hint adds to the hint of the reason."""
    return replace(request, text=message.hint.removeprefix(request.reason.hint).removeprefix(': '))


_WEIGHED = 1  # of MassEstimate.status
_RUN = 1  # of StopRequest.state; 0 is STOP
_MOST = 10_000  # characters, or entries of a list
_item = partial(_Form, stamp='t3', frame='weigh_belt')
_FORMS: dict[type, _Form] = {
    records.LoadCell: _Form(stamp='', frame='load_cell'),
    records.SampleBlock: _Form(frame='load_cell'),
    records.EyeEdge: _Form(frame=lambda edge: edge.eye.name.lower()),
    records.Item: _Form(frame='weigh_belt'),
    records.StreamStatus: _Form(
        unknown={'state': records.StreamState.FAILED}, newer=('last_edge',)
    ),
    records.WeighWindow: _item(names={'t3': 't3', 'stamp': 'first_stamp'}),
    records.MassEstimate: _item(
        names={'t3': 't3'}, derived={'status': lambda each: int(each.weighed)}, amend=_with_reason
    ),
    records.Verdict: _item(
        unknown={'decision': records.Decision.FAULT}, newer=('station', 'station_at')
    ),
    records.Statistics: _Form(newer=('tu1_quota', 'mean_value')),
    records.ZeroChange: _Form(frame='load_cell'),
    records.ExternalReject: _Form(frame=attrgetter('device')),
    records.MachineConditions: _Form(frame='machine'),
    records.Alarm: _Form(stamp='first'),
    records.PerformanceTest: _Form(unknown={'state': records.PerformanceState.OVERDUE}),
    records.StopRequest: _Form(
        frame='rejector',
        unknown={'reason': StopReason.UNKNOWN},
        lacks=('text',),
        derived={'hint': attrgetter('hint')},
        absent={'state': _RUN},
        amend=_with_text,
    ),
}


def to_message(port: Port, record: Any, *, stamp: int | None = None) -> Any:
    """Return the message of a record for rclpy.

    `record` has the port's class. None gives the message that means no record. `stamp`, ns, is for
    the header of a record without a stamp.
    """
    message = port.type()
    if record is None and port.record is not None:
        return _filled(message, _plan(cast(Any, port.record)).form.absent)
    return _filled(message, to_fields(record, stamp))


def to_fields(record: Any, stamp: int | None = None) -> dict[str, Any]:
    """Return the fields of a record's message by name.

    Header and times are mappings. Arrays are contiguous and of the type of the message. Nested
    records are messages of rclpy. All other fields are plain Python values.
    """
    plan = _plan(cast(Any, type(record)))
    form = plan.form
    time = _time(getattr(record, form.stamp) if form.stamp else stamp)
    frame = form.frame if isinstance(form.frame, str) else form.frame(record)
    return {
        'header': {'stamp': time, 'frame_id': frame},
        **{place: convert(get(record)) for place, get, convert in plan.write},
    }


def to_record(port: Port, message: Any) -> Any:
    """Return the record of a message of rclpy or of a bag, None if the message has none.

    Its arrays share the memory of the message, and are read-only.

    Raises
    ------
    ValueError
        If a value is impossible in the record, such as an eye that does not exist.
    """
    assert port.record is not None, f'{port.name} has no record'
    return _record(port.record, message)


def _record(kind: Any, message: Any) -> Any:
    plan = _plan(kind)
    form = plan.form
    if form.absent and all(getattr(message, k) == value for k, value in form.absent.items()):
        return None
    record = kind(*[convert(get(message)) for get, convert in plan.read])
    return record if form.amend is None else form.amend(message, record)


def _filled(message: Any, fields: Mapping[str, Any]) -> Any:
    """Fill in an empty message, because constructing it from its parts is slower."""
    for name, value in fields.items():
        if isinstance(value, dict):
            _filled(getattr(message, name), value)
        elif isinstance(value, np.ndarray):  # an ndarray takes twenty times as long
            setattr(message, name, array.array(value.dtype.char, value.tobytes()))
        else:
            setattr(message, name, value)
    return message


_Get = Callable[[Any], Any]


@dataclass(slots=True)
class _Plan:
    """Conversion of a class of records, field by field."""

    form: _Form
    # Name in the message, getter of the value from the record, and converter.
    write: list[tuple[str, _Get, _Get]] = field(default_factory=list)
    # For each field of the record: getter of the value from the message, and converter.
    read: list[tuple[_Get, _Get]] = field(default_factory=list)


@cache
def _plan(kind: Any) -> _Plan:
    form = _FORMS.get(kind, _Form())
    plan = _Plan(form)
    names = {form.stamp: 'header.stamp', **form.names}
    defaults = {each.name: each.default for each in fields(kind)}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name in form.lacks:
            continue
        place = names.get(name, name)
        get: _Get = attrgetter(place)
        convert = _reader(hint, form.unknown.get(name))
        if name in form.newer:
            get, convert = _newer(place, convert, defaults[name])
        plan.read.append((get, convert))
        if place != 'header.stamp':
            plan.write.append((place, attrgetter(name), _writer(hint)))
    plan.write += [(place, derive, lambda value: value) for place, derive in form.derived.items()]
    return plan


def _newer(name: str, convert: _Get, default: object) -> tuple[_Get, _Get]:
    """Return the functions that get and convert a field which messages of older bags lack."""
    return (
        lambda message: getattr(message, name, None),
        lambda value: default if value is None else convert(value),
    )


def newer_fields(record: type) -> frozenset[str]:
    """Return the fields of the message of a record that messages of older bags lack."""
    return frozenset(_FORMS.get(record, _Form()).newer)


def _writer(hint: Any) -> Callable[[Any], Any]:
    if hint in (records.Stamp, records.Stamp | None):
        return _time
    if get_origin(hint) is np.ndarray:
        return partial(np.ascontiguousarray, dtype=_dtype(hint))
    if get_origin(hint) is tuple:
        convert = _writer(get_args(hint)[0])
        return lambda values: list(map(convert, values))
    if is_dataclass(hint) and isinstance(hint, type):
        kind = interface(f'checkweigher_msgs/msg/{hint.__name__}')
        return lambda record: _filled(kind(), to_fields(record))
    if issubclass(hint, str):
        return _text
    return next(plain for plain in (bool, int, float) if issubclass(hint, plain))


def _reader(hint: Any, unknown: Any) -> Callable[[Any], Any]:
    if hint == records.Stamp:
        return stamp_from
    if hint == records.Stamp | None:
        return lambda time: stamp_from(time) or None  # 0 means that it is unknown
    if get_origin(hint) is np.ndarray:
        return partial(_shared, dtype=_dtype(hint))
    if get_origin(hint) is tuple:
        read = _reader(get_args(hint)[0], None)
        return lambda values: tuple(map(read, _bounded(values)))
    if is_dataclass(hint):
        return partial(_record, hint)
    if hint is str:
        return lambda text: str(_bounded(text))
    return cast(_Get, hint) if unknown is None else partial(_member, hint, unknown)


def _member(kind: type[Enum], unknown: Enum, value: object) -> Enum:
    """Return a member of an enumeration, `unknown` if none has the value."""
    try:
        return kind(value)
    except ValueError:
        return unknown


def _text(value: str) -> str:
    """Return a string that UTF-8 can encode; surrogates of file names or YAML become escapes."""
    text = str(value)
    return text if text.isascii() else text.encode(errors='backslashreplace').decode()


def _time(stamp: int | None) -> dict[str, int]:
    """Return a stamp in ns as s and ns, 0 if it is unknown or no time message can hold it."""
    sec, nanosec = divmod(int(stamp or 0), records.NANOSECONDS)
    # An edge may have a stamp past 2038, and `reject_at` may be past 2038 even if no edge is.
    held = -(2**31) <= sec < 2**31
    return {'sec': sec, 'nanosec': nanosec} if held else {'sec': 0, 'nanosec': 0}


def stamp_from(time: Any) -> int:
    """Return a time message in ns."""
    return int(time.sec) * records.NANOSECONDS + int(time.nanosec)


def _dtype(hint: Any) -> np.dtype[Any]:
    return np.dtype(get_args(get_args(hint)[1])[0])


def _bounded(field: Any, most: int = _MOST) -> Any:
    """Return a field of a message; ValueError if it is too long for a message of a line."""
    if len(field) > most:
        raise ValueError(f'{len(field)} in a field of a message, at most {most}')
    return field


def _shared(field: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the values of a field, read-only because other nodes may have the same message."""
    values: NDArray[Any] = np.frombuffer(_bounded(field, records.MAX_WINDOW), dtype)
    values.flags.writeable = False
    return values
