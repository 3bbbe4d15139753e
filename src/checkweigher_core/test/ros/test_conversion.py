# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the conversion of records to serialised messages and back."""

from dataclasses import fields, is_dataclass, replace
from enum import Enum
import itertools
from typing import Any, get_args, get_origin, get_type_hints

from checkweigher_msgs import msg as messages
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from checkweigher_core.records import (
    MAX_WINDOW,
    Decision,
    Eye,
    EyeEdge,
    LoadCell,
    Reference,
    SampleBlock,
    Stamp,
    StepState,
    StopRequest,
    StreamState,
    Verdict,
    VerificationStep,
    WeighWindow,
)
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_fields, to_message, to_record
from checkweigher_core.ros.ports import Port

T1 = 1_700_000_000_123_456_789

WINDOW = WeighWindow(
    7, T1, T1 + 100_000_001, T1 + 200_000_002, 1.5, 0.1, 1.25, 960.0, -1e6, 5000.5, 5001.25, 0.125,
    first_index=2**40, stamp=T1 - 400_000_003, empty_begin=12, window_begin=20, window_end=28,
    counts=np.arange(-5, 25, dtype=np.int32), denoised=np.linspace(-1.0, 1.0, 30),
    reasons=('MissingEdge', 'BeltSpeed'),
)  # fmt: skip
CELL = LoadCell(960.0, -1e6, 5000.5, -8_000_000, 8_000_001, 3.0, 0.35, 'PW15', 'A7')
EDGE = EyeEdge(T1, Eye.OUTFEED, True)
_NUMBERS = itertools.count(1)


def example(hint: Any) -> Any:
    """Return a value of a type. It differs from defaults and, for numbers, from other examples."""
    number = next(_NUMBERS)
    if hint in (Stamp, Stamp | None):
        return T1 + number
    if get_origin(hint) is tuple:
        return (example(get_args(hint)[0]), example(get_args(hint)[0]))
    if get_origin(hint) is np.ndarray:
        return np.arange(number, number + 5).astype(get_args(get_args(hint)[1])[0])
    if issubclass(hint, Enum):
        return list(hint)[1]  # neither the first member nor the member for unknown values
    if is_dataclass(hint):
        return record_of(hint)
    if hint is bool:
        return True
    return f'text {number}' if hint is str else hint(number)


def record_of(kind: type) -> Any:
    """Return a record with an example of each field."""
    hints = get_type_hints(kind, include_extras=True)
    return CELL if kind is LoadCell else kind(**{name: example(hints[name]) for name in hints})


PORTS = [port for port in (*ports.ALL, ports.VERIFICATION_PROGRESS) if port.record is not None]
VERDICT = record_of(Verdict)


def through_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize('port', PORTS, ids=lambda port: port.name)
def test_every_field_passes_through_its_message(port: Port):
    record = record_of(port.record)
    found = to_record(port, through_the_wire(to_message(port, record)))
    for entry in fields(record):
        passed, value = getattr(found, entry.name), getattr(record, entry.name)
        np.testing.assert_array_equal(passed, value, entry.name)
        assert type(passed) is type(value), entry.name


def test_samples_are_shared_with_their_message():
    block = SampleBlock(T1, 2**40, np.arange(-3, 3, dtype=np.int32))
    message = through_the_wire(to_message(ports.LOAD_CELL_SAMPLES, block))

    found = to_record(ports.LOAD_CELL_SAMPLES, message)

    assert found.counts.dtype == np.int32
    assert not found.counts.flags.writeable
    assert np.shares_memory(found.counts, np.frombuffer(message.counts, np.int32))


@pytest.mark.parametrize(
    ('port', 'record', 'frame'),
    [
        (ports.LOAD_CELL_INFO, CELL, 'load_cell'),
        (ports.PHOTO_EYES, EDGE, 'outfeed'),
        (ports.VERDICT, VERDICT, 'weigh_belt'),
        (ports.REFERENCE_MASS, Reference(T1, 0.2), ''),
    ],
)
def test_a_header_has_stamp_and_frame(port: Port, record: Any, frame: str):
    header = to_message(port, record, stamp=T1 + 2).header
    stamp = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
    assert header.frame_id == frame
    assert stamp == {LoadCell: T1 + 2, Verdict: VERDICT.t3}.get(type(record), T1)


def test_time_and_empty_belt_of_a_window_stand_in_its_message():
    message = to_message(ports.WEIGH_WINDOW, WINDOW)

    assert (message.first_stamp.sec, message.first_stamp.nanosec) == (1_699_999_999, 723_456_786)
    assert message.empty_begin == 12
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_700_000_000, 323_456_791)


def test_numbers_of_numpy_become_those_of_python():
    # A numpy scalar in a field would abort the process when the message is serialised.
    values = {entry.name: getattr(WINDOW, entry.name) for entry in fields(WINDOW)}
    numbers = {n: np.asarray(v)[()] for n, v in values.items() if isinstance(v, int | float)}

    message = to_message(ports.WEIGH_WINDOW, replace(WINDOW, **numbers))

    assert {'stamp', 'empty_begin', 'zero'} <= set(numbers)
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        assert not isinstance(value, np.generic), name
    assert to_record(ports.WEIGH_WINDOW, through_the_wire(message)) == WINDOW


def test_the_fields_for_other_writers_are_those_of_the_message():
    fields_ = to_fields(replace(WINDOW, item_id=np.int64(7), counts=WINDOW.counts[::-1]))
    message = to_message(ports.WEIGH_WINDOW, WINDOW)

    assert set(fields_) == set(message.get_fields_and_field_types())
    assert type(fields_['item_id']) is int
    assert fields_['counts'].flags.c_contiguous
    assert fields_['t1'] == {'sec': message.t1.sec, 'nanosec': message.t1.nanosec}
    assert fields_['header']['frame_id'] == 'weigh_belt'


def test_a_stamp_that_no_time_message_can_hold_is_not_known():
    message = to_message(ports.VERDICT, replace(VERDICT, reject_at=2**31 * 1_000_000_000))

    assert to_record(ports.VERDICT, message) == replace(VERDICT, reject_at=None)


def test_what_is_not_known_of_a_fault_stays_unknown():
    fault = WeighWindow(3, None, T1, None, reasons=('MissingEdge',))
    message = to_message(ports.WEIGH_WINDOW, fault)

    assert to_record(ports.WEIGH_WINDOW, through_the_wire(message)) == fault


def test_a_message_that_was_not_filled_in_is_no_mass_and_no_acceptance():
    assert to_record(ports.MASS_ESTIMATE, messages.MassEstimate()).reasons == ('Unknown',)
    for mass in (float('nan'), float('inf'), 1e308, 0.0, -0.1):
        weighed = messages.MassEstimate(status=1, mass=mass)
        assert to_record(ports.MASS_ESTIMATE, weighed).reasons == ('Unknown',)
    assert to_record(ports.VERDICT, messages.Verdict()).decision is Decision.FAULT
    assert to_record(ports.VERDICT, messages.Verdict(decision=99)).decision is Decision.FAULT
    assert to_record(ports.STOP_REQUEST, messages.StopRequest()).reason is StopReason.UNKNOWN
    status = messages.StreamStatus(state=99)
    assert to_record(ports.DRIVER_STATUS, status).state is StreamState.FAILED


def test_an_eye_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match='7'):
        to_record(ports.PHOTO_EYES, messages.PhotoEyeEvent(eye=7))


def test_a_line_that_may_run_is_no_stop_request():
    message = through_the_wire(to_message(ports.STOP_REQUEST, None))

    assert message.state == message.RUN
    assert to_record(ports.STOP_REQUEST, message) is None
    stop = to_message(ports.STOP_REQUEST, StopRequest(StopReason.NOT_READY, 0, None, 'text'))
    assert (stop.state, stop.reason) == (stop.STOP, 'NotReady')
    assert stop.hint == f'{StopReason.NOT_READY.hint}: text'


def test_the_parameters_of_a_trained_machine_are_no_text_that_is_too_long():
    identity = VerificationStep(1, '', StepState.IDENTITY, text='x' * 100_000)
    assert to_record(ports.VERIFICATION, to_message(ports.VERIFICATION, identity)) == identity


@pytest.mark.parametrize(
    ('port', 'values'),
    [
        (ports.LOAD_CELL_SAMPLES, {'counts': [0] * (MAX_WINDOW + 1)}),
        (ports.WEIGH_WINDOW, {'denoised': [0.0] * (MAX_WINDOW + 1)}),
        (ports.WEIGH_WINDOW, {'reasons': ['Saturation'] * 10_001}),
        (ports.WEIGH_WINDOW, {'reasons': ['x' * 10_001]}),
        (ports.LOAD_CELL_INFO, {'model': 'x' * 10_001}),
    ],
)
def test_what_is_too_long_for_a_line_is_refused(port, values):
    with pytest.raises(ValueError, match='in a message field, but at most'):
        to_record(port, port.type(**values))
