# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records to messages and back, through the wire."""

from dataclasses import fields, replace
from typing import Any

from checkweigher_msgs import msg as messages
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from checkweigher_core.records import (
    MAX_WINDOW,
    BatchResult,
    Decision,
    ExternalReject,
    Eye,
    EyeEdge,
    FillerFeedback,
    Item,
    LoadCell,
    MachineConditions,
    MassEstimate,
    PerformanceState,
    PerformanceTest,
    Permission,
    ProductOnLine,
    ProgressState,
    Reference,
    SampleBlock,
    Statistics,
    StepState,
    StopRequest,
    StreamState,
    StreamStatus,
    Verdict,
    VerificationProgress,
    VerificationStep,
    WeighWindow,
    ZeroChange,
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
ESTIMATE = MassEstimate(
    7, T1, T1 + 1, T1 + 2, (), 0.2, 1e-4, -1e-3, 1.5, 0.1, 1.25, 'hann', -1.8, 0.9, 0.02, 38.0, 0.06
)
VERDICT = Verdict(
    7,
    T1 + 2,
    Decision.OVER,
    ('NoLoad',),
    0.2,
    1e-4,
    0.1,
    0.15,
    T1 + 5,
    t1=T1,
    estimate_id=8,
    late=True,
    product='crisps',
    batch='b7',
    batch_items=40,
    batch_accepted=30,
    batch_below_tu1=1,
    batch_surplus=-0.02,
    station=2,
    station_at=T1 + 6,
)
CELL = LoadCell(960.0, -1e6, 5000.5, -8_000_000, 8_000_001, 3.0, 0.35, 'PW15', 'A7')
EDGE = EyeEdge(T1, Eye.OUTFEED, True)
STATISTICS = Statistics(
    T1, 'crisps', 'b7', 10, 1, 2, 3, 4, ('BeltSpeed', 'NoLoad'), (5, 2), 6, 7, 0.15, 0.01, 0.151,
    1e-3, 2e-3, 0.14, 0.13, 8, 9, 0.25, 120.5, 0.025, True,
)  # fmt: skip
# Of each record one without a value that it would also have by default.
RECORDS = [
    (ports.LOAD_CELL_INFO, CELL, LoadCell(1.0, 1.0, 0.0, 0, 1, 1.0, 1.0)),
    (ports.PHOTO_EYES, EDGE, EyeEdge(0, Eye.INFEED, False)),
    (ports.REFERENCE_MASS, Reference(T1, 0.2), Reference(0, 0.0)),
    (
        ports.DRIVER_STATUS,
        StreamStatus(T1, 2, StreamState.FINISHED, 3, 4, 5, 'no samples', T1 + 1),
        StreamStatus(0, 0, StreamState.RUNNING),
    ),
    (
        ports.ITEMS,
        Item(T1, 2, 3, T1, T1 + 1, T1 + 2, 0.5, True, ('MissingEdge',)),
        Item(None, 0, 0),
    ),
    (ports.WEIGH_WINDOW, WINDOW, WeighWindow(0, None, None, None)),
    # With a reason there would be no mass.
    (ports.MASS_ESTIMATE, ESTIMATE, None),
    (
        ports.MASS_ESTIMATE,
        replace(ESTIMATE, reasons=('NoLoad',)),
        MassEstimate(0, None, None, None),
    ),
    (ports.VERDICT, VERDICT, Verdict(0, None, Decision.FAULT)),
    (ports.ZERO_SETTING, ZeroChange(T1, 1e-3, -1e-3, 1e-4), ZeroChange(0, 0.0, 0.0, 0.0)),
    (
        ports.VERIFICATION,
        VerificationStep(T1, 'zero_1', StepState.SKIPPED, T1 - 1, 'no weights'),
        VerificationStep(0, '', StepState.PLAN),
    ),
    (
        ports.VERIFICATION_PROGRESS,
        VerificationProgress(
            T1,
            ProgressState.ASKING,
            3,
            '/machine',
            'v1',
            ('zero_1', 'zero_2'),
            ('passed', ''),
            1,
            'Leave the belt empty',
            ('zero: +0.1 g',),
        ),
        VerificationProgress(0, ProgressState.IDLE),
    ),
    (ports.STOP_REQUEST, StopRequest(StopReason.TOO_MANY_REJECTS, 7, T1), None),
    (ports.PERMISSION, Permission(T1, True), Permission(0, False)),
    (
        ports.STATISTICS,
        STATISTICS,
        Statistics(None, *2 * [''], *5 * [0], *2 * [()], 0, 0, *7 * [0.0], 0, 0, 0.0, 0.0, 0.0),
    ),
    (
        ports.FILLER_FEEDBACK,
        FillerFeedback(T1, 'crisps', 7, 10, 0.15, 0.149, 5e-4, 2e-3, True),
        FillerFeedback(None, '', 0, 0, 0.0, 0.0, 0.0, 0.0),
    ),
    (
        ports.BATCH_RESULT,
        BatchResult(T1, 'b7', '/var/batches/b7.jsonl', 64 * 'a'),
        BatchResult(0, '', '', ''),
    ),
    (
        ports.EXTERNAL_REJECT,
        ExternalReject(T1, 'metal', 7, 'ferrous'),
        ExternalReject(None, ''),
    ),
    (
        ports.MACHINE_CONDITIONS,
        MachineConditions(T1, True, ('BinFull',), ('bin_full',)),
        MachineConditions(0, False),
    ),
    (
        ports.PRODUCT_ON_LINE,
        ProductOnLine(
            T1,
            'crisps',
            'b7',
            True,
            0.09,
            0.11,
            0.05,
            0.2,
            0.3,
            1.5,
            0.1,
            0.095,
            0.02,
            True,
            True,
            40,
            38,
            1,
            0.002,
        ),
        ProductOnLine(0),
    ),
    (
        ports.PERFORMANCE_TEST,
        PerformanceTest(
            T1,
            PerformanceState.FAILED,
            'crisps',
            'b7',
            '1 error',
            'ann',
            T1 + 1,
            T1 + 2,
            T1 - 1,
            0.15,
            1e-3,
            3,
            (1e-4, 2e-3),
        ),
        PerformanceTest(0, PerformanceState.OVERDUE),
    ),
]


def through_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def test_every_record_is_tried():
    beside = (ports.VERIFICATION_PROGRESS,)
    known = {port.record for port in (*ports.ALL, *beside)} - {None}
    assert {type(record) for _, record, _ in RECORDS} | {SampleBlock} == known


@pytest.mark.parametrize(('port', 'record', 'default'), RECORDS)
def test_every_field_passes_through_its_message(port: Port, record: Any, default: Any):
    for entry in fields(record) if default is not None else ():
        value, unset = getattr(record, entry.name), getattr(default, entry.name)
        assert not np.array_equal(np.asarray(value), np.asarray(unset)), entry.name

    assert to_record(port, through_the_wire(to_message(port, record))) == record


def test_samples_pass_through_their_message_and_are_shared():
    block = SampleBlock(T1, 2**40, np.arange(-3, 3, dtype=np.int32))
    message = through_the_wire(to_message(ports.LOAD_CELL_SAMPLES, block))

    found = to_record(ports.LOAD_CELL_SAMPLES, message)

    assert (found.stamp, found.first_index) == (block.stamp, block.first_index)
    np.testing.assert_array_equal(found.counts, block.counts)
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
    # A numpy scalar in a field would abort the process as the message is serialised.
    numbers = {
        f.name: np.int64(getattr(WINDOW, f.name))
        for f in fields(WINDOW)
        if isinstance(getattr(WINDOW, f.name), int)
    }
    numbers |= {
        f.name: np.float64(getattr(WINDOW, f.name))
        for f in fields(WINDOW)
        if isinstance(getattr(WINDOW, f.name), float)
    }

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
    with pytest.raises(ValueError, match='in a field of a message, at most'):
        to_record(port, port.type(**values))
