"""Records to messages and back, through the wire."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

from checkweigher_msgs import msg as messages
from checkweigher_msgs.srv import LineHistory as LineHistoryService
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from checkweigher_dsp.records import (
    Decision,
    Eye,
    EyeEdge,
    LineHistory,
    MassEstimate,
    Verdict,
    WeighWindow,
)
from checkweigher_dsp.ros import conversion

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
)


def through_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


@pytest.mark.parametrize(
    ('record', 'to', 'back'),
    [
        (WINDOW, conversion.window_to, conversion.window_from),
        (ESTIMATE, conversion.estimate_to, conversion.estimate_from),
        (VERDICT, conversion.verdict_to, conversion.verdict_from),
    ],
    ids=['window', 'estimate', 'verdict'],
)
def test_every_field_passes_through_its_message(
    record: Any, to: Callable[[Any], Any], back: Callable[[Any], Any]
):
    assert back(through_the_wire(to(record))) == record


@pytest.mark.parametrize(
    ('record', 'unknown'),
    [
        (WINDOW, WeighWindow(0, None, None, None)),
        # With a reason there would be no mass.
        (replace(ESTIMATE, reasons=('NoLoad',)), MassEstimate(0, None, None, None)),
        (VERDICT, Verdict(0, None, Decision.FAULT)),
    ],
    ids=['window', 'estimate', 'verdict'],
)
def test_each_field_is_tried_with_a_value_that_is_not_its_default(record: Any, unknown: Any):
    for entry in fields(record):
        value, default = getattr(record, entry.name), getattr(unknown, entry.name)
        assert not np.array_equal(np.asarray(value), np.asarray(default)), entry.name


def test_time_and_empty_belt_of_a_window_stand_in_its_message():
    message = conversion.window_to(WINDOW)

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

    message = conversion.window_to(replace(WINDOW, **numbers))

    assert {'stamp', 'empty_begin', 'zero'} <= set(numbers)
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        assert not isinstance(value, np.generic), name
    assert conversion.window_from(through_the_wire(message)) == WINDOW


def test_what_is_not_known_of_a_fault_stays_unknown():
    fault = WeighWindow(3, None, T1, None, reasons=('MissingEdge',))

    assert conversion.window_from(through_the_wire(conversion.window_to(fault))) == fault


def test_a_message_that_nobody_filled_in_is_no_mass_and_no_acceptance():
    assert conversion.estimate_from(messages.MassEstimate()).reasons == ('Unknown',)
    assert conversion.verdict_from(messages.Verdict()).decision is Decision.FAULT
    assert conversion.verdict_from(messages.Verdict(decision=99)).decision is Decision.FAULT


def test_a_history_passes_through_its_service():
    edges = (EyeEdge(T1, Eye.INFEED, True), EyeEdge(T1 + 1, Eye.OUTFEED, False))
    history = LineHistory(7, T1 + 2, 5, edges, (VERDICT,))

    response = conversion.fill_history(history, LineHistoryService.Response())

    assert conversion.history_from(through_the_wire(response)) == history
