# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conversion of records to messages and back.

A field of a record corresponds to the field of the message with the same name. `_FORMS` describes
the records whose fields differ from the fields of the message. Messages of rclpy and messages from
bags can be converted to records. Every field of a message is set to a value of its exact Python
type. rclpy does not check types, and a numpy scalar in a field would abort the process when the
message is serialised.
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

_MOST = 10_000  # largest number of characters of a string, or of elements of a list


@dataclass(frozen=True)
class _Form:
    """Differences between the fields of a record and of its message."""

    # Name of the field of the record that becomes the stamp of the header. If the name is empty,
    # the caller provides the stamp. If the name is also in `names`, the message contains the stamp
    # a second time, in a field of its own.
    stamp: str = 'stamp'
    # The frame_id of the header, or a function that returns the frame_id of a record.
    frame: str | Callable[[Any], str] = ''
    # Names of fields in the message by their names in the record.
    names: Mapping[str, str] = field(default_factory=dict)
    # Functions that compute further fields of the message from the record.
    derived: Mapping[str, Callable[[Any], object]] = field(default_factory=dict)
    # Enumeration members that replace unknown values, by the name of the field. A message with an
    # unknown value is refused if the mapping does not contain the field.
    unknown: Mapping[str, object] = field(default_factory=dict)
    # Values, by field, of the message that is sent in place of None. A message with all of these
    # values is converted to None. If the mapping is empty, no message is converted to None.
    absent: Mapping[str, object] = field(default_factory=dict)
    # Function that corrects a record by means of its message.
    amend: Callable[[Any, Any], Any] | None = None
    lacks: tuple[str, ...] = ()  # fields at the end of the record that the message lacks
    longest: int = _MOST  # largest number of characters of a string


def _with_reason(message: Any, estimate: records.MassEstimate) -> records.MassEstimate:
    """Return an estimate, which gets the reason Unknown if it has neither a mass nor a reason.

    A mass counts as missing if the status of the message is not WEIGHED, or if the mass is NaN, 0
    kg or less, or above `records.MAX_MASS`.
    """
    weighed = message.status == _WEIGHED and 0 < estimate.mass <= records.MAX_MASS
    return estimate if weighed or estimate.reasons else replace(estimate, reasons=('Unknown',))


def _with_text(message: Any, request: records.StopRequest) -> records.StopRequest:
    """Return a stop request with the text that follows the hint of the reason in the message."""
    return replace(request, text=message.hint.removeprefix(request.reason.hint).removeprefix(': '))


_WEIGHED = 1  # status of a MassEstimate message with a mass
_RUN = 1  # state of a StopRequest message without a request
_item = partial(_Form, stamp='t3', frame='weigh_belt')
_FORMS: dict[type, _Form] = {
    records.LoadCell: _Form(stamp='', frame='load_cell'),
    records.SampleBlock: _Form(frame='load_cell'),
    records.EyeEdge: _Form(frame=lambda edge: edge.eye.name.lower()),
    records.Item: _Form(frame='weigh_belt'),
    records.StreamStatus: _Form(unknown={'state': records.StreamState.FAILED}),
    records.WeighWindow: _item(names={'t3': 't3', 'stamp': 'first_stamp'}),
    records.MassEstimate: _item(
        names={'t3': 't3'}, derived={'status': lambda each: int(each.weighed)}, amend=_with_reason
    ),
    records.Verdict: _item(unknown={'decision': records.Decision.FAULT}),
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
    # A long text is allowed, because the identity of a machine contains all changes in the audit
    # log and all parameters. Training makes some parameters long lists.
    records.VerificationStep: _Form(longest=1_000_000),
}


def to_message(port: Port, record: Any, *, stamp: int | None = None) -> Any:
    """Return the rclpy message of a record, or the message that stands for None.

    If the record has no field for the stamp, `stamp` in ns becomes the stamp of the header; None is
    an unknown stamp.
    """
    message = port.type()
    if record is None and port.record is not None:
        return _filled(message, _plan(cast(Any, port.record)).form.absent)
    return _filled(message, to_fields(record, stamp))


def to_fields(record: Any, stamp: int | None = None) -> dict[str, Any]:
    """Return the message fields of a record by name.

    The header and all times are mappings. Arrays are contiguous, and have the element type of the
    message. Nested records are rclpy messages. All other values have built-in Python types. `stamp`
    is used as in `to_message`.
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
    """Return the record of a message from rclpy or a bag, or None if the message stands for None.

    The arrays of the record share the memory of the message, and are read-only.

    Raises
    ------
    ValueError
        If a value is impossible in the record, such as a photo-eye that does not exist, or if a
        text, a list or an array is too long.
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
    """Fill an empty message, and return it.

    Setting the fields is faster than a call of the constructor with the fields as arguments.
    """
    for name, value in fields.items():
        if isinstance(value, dict):
            _filled(getattr(message, name), value)
        elif isinstance(value, np.ndarray):  # rclpy would need twenty times as long for an ndarray
            setattr(message, name, array.array(value.dtype.char, value.tobytes()))
        else:
            setattr(message, name, value)
    return message


_Get = Callable[[Any], Any]


@dataclass(slots=True)
class _Plan:
    """Conversion of one class of records to messages and back."""

    form: _Form
    # For each field of the message: its name, the function that gets its value from the record, and
    # the function that converts this value.
    write: list[tuple[str, _Get, _Get]] = field(default_factory=list)
    # For each field of the record: the function that gets its value from the message, and the
    # function that converts this value.
    read: list[tuple[_Get, _Get]] = field(default_factory=list)


@cache
def _plan(kind: Any) -> _Plan:
    form = _FORMS.get(kind, _Form())
    plan = _Plan(form)
    newer = records.newer_fields(kind)
    names = {form.stamp: 'header.stamp', **form.names}
    defaults = {each.name: each.default for each in fields(kind)}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name in form.lacks:
            continue
        place = names.get(name, name)
        get: _Get = attrgetter(place)
        convert = _reader(hint, form.unknown.get(name), form.longest)
        if name in newer:
            get, convert = _newer(place, convert, defaults[name])
        plan.read.append((get, convert))
        if place != 'header.stamp':
            plan.write.append((place, attrgetter(name), _writer(hint)))
    plan.write += [(place, derive, lambda value: value) for place, derive in form.derived.items()]
    return plan


def _newer(name: str, convert: _Get, default: object) -> tuple[_Get, _Get]:
    """Return the getter and the converter of a field that messages in older bags do not have."""
    return (
        lambda message: getattr(message, name, None),
        lambda value: default if value is None else convert(value),
    )


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


def _reader(hint: Any, unknown: Any, longest: int) -> Callable[[Any], Any]:
    if hint == records.Stamp:
        return stamp_from
    if hint == records.Stamp | None:
        return lambda time: stamp_from(time) or None  # a stamp of 0 is unknown
    if get_origin(hint) is np.ndarray:
        return partial(_shared, dtype=_dtype(hint))
    if get_origin(hint) is tuple:
        read = _reader(get_args(hint)[0], None, longest)
        return lambda values: tuple(map(read, _bounded(values)))
    if is_dataclass(hint):
        return partial(_record, hint)
    if hint is str:
        return lambda text: str(_bounded(text, longest))
    return cast(_Get, hint) if unknown is None else partial(_member, hint, unknown)


def _member(kind: type[Enum], unknown: Enum, value: object) -> Enum:
    """Return the enumeration member with a value, or `unknown` if no member has this value."""
    try:
        return kind(value)
    except ValueError:
        return unknown


def _text(value: str) -> str:
    """Return a string that UTF-8 can encode. Surrogates become escape sequences."""
    text = str(value)
    return text if text.isascii() else text.encode(errors='backslashreplace').decode()


def _time(stamp: int | None) -> dict[str, int]:
    """Return the fields of a time message for a stamp in ns, both 0 for an unknown stamp.

    Both fields are also 0 for a stamp before December 1901 or after January 2038, because a time
    message cannot contain such a stamp.
    """
    sec, nanosec = divmod(int(stamp or 0), records.NANOSECONDS)
    held = -(2**31) <= sec < 2**31
    return {'sec': sec, 'nanosec': nanosec} if held else {'sec': 0, 'nanosec': 0}


def stamp_from(time: Any) -> int:
    """Return the stamp of a time message in ns, which is 0 if the time is unknown."""
    return int(time.sec) * records.NANOSECONDS + int(time.nanosec)


def _dtype(hint: Any) -> np.dtype[Any]:
    return np.dtype(get_args(get_args(hint)[1])[0])


def _bounded(field: Any, most: int = _MOST) -> Any:
    """Return a string or list of a message unchanged.

    Raises ValueError if the string or list has more than `most` characters or elements.
    """
    if len(field) > most:
        raise ValueError(f'{len(field)} values in a message field, but at most {most} are allowed')
    return field


def _shared(field: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the array of a field without copying it.

    The array is read-only, because other nodes may use the same message. Raises ValueError if the
    array has more than `records.MAX_WINDOW` elements.
    """
    values: NDArray[Any] = np.frombuffer(_bounded(field, records.MAX_WINDOW), dtype)
    values.flags.writeable = False
    return values
