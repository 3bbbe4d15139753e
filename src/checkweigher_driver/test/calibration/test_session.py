# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a calibration on a line takes for a load at rest, and what it refuses."""

from collections.abc import Iterable

import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock
from checkweigher_driver.calibration.session import CalibrationSession
from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    RestReading,
    StaticReading,
    Steadiness,
)

RATE, SENSITIVITY = 960.0, 5e5
CELL = LoadCell(RATE, SENSITIVITY, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
STEADINESS = Steadiness(duration=1.0, tolerance=1e-4, patience=4.0)
SIZE = 96  # samples in a block of 0.1 s
BLOCKED, CLEAR = EyeEdge(0, Eye.INFEED, True), EyeEdge(1, Eye.INFEED, False)


def block(number: int, value: float) -> SampleBlock:
    return SampleBlock(0, SIZE * number, np.full(SIZE, round(value), np.int32))


def found(readings: Iterable[StaticReading | None]) -> StaticReading:
    """Return the first reading that there is."""
    return next(reading for reading in readings if reading is not None)


def fed(session: CalibrationSession, mass: float, said: float) -> None:
    """Read a mass that is said to be another; the scale has a zero of 1000."""
    session.begin(said, 0.0, ())
    found(session.add(block(number, 1000 + SENSITIVITY * mass), 0.0) for number in range(20))


def test_a_load_is_read_once_it_has_been_at_rest_for_the_whole_duration():
    reading, moving = RestReading(CELL, STEADINESS), np.arange(1000, 1000 + 2 * 960, 2)
    for number, piece in enumerate(np.array_split(moving.astype(np.int32), 20)):  # 4 g a second
        assert reading.add(SampleBlock(0, SIZE * number, piece)) is None
    number = 20
    while (rested := reading.add(block(number, 5000))) is None:
        number += 1
    assert rested.mean == 5000  # nothing of what moved is in it
    assert (number - 20) * SIZE >= RATE - SIZE


def test_a_load_that_goes_on_moving_is_given_up_with_the_figures():
    reading = RestReading(CELL, STEADINESS)
    # 1 g/s: the halves of a second are 0.5 g apart.
    numbers = np.arange(5 * 960).reshape(-1, SIZE)
    pieces = np.round(numbers * SENSITIVITY * 1e-3 / RATE).astype(np.int32)
    with pytest.raises(CalibrationError, match=r'drifts by 0\.5\d\d g.*within 0\.1 g'):
        found(reading.add(SampleBlock(0, SIZE * n, piece)) for n, piece in enumerate(pieces))


def test_samples_that_were_lost_begin_it_again_and_are_named():
    reading = RestReading(CELL, STEADINESS)
    with pytest.raises(CalibrationError, match='samples were lost'):
        found(reading.add(block(number + number // 8, 1000)) for number in range(100))


def test_a_converter_at_its_limit_is_refused():
    session = CalibrationSession(CELL, STEADINESS)
    session.begin(1.0, 0.0, ())
    with pytest.raises(CalibrationError, match='converter is at its limit'):
        found(session.add(block(number, 2**23 - 1), 0.0) for number in range(20))
    assert not session.reading
    assert session.points == []


def test_nothing_is_read_while_products_pass():
    session = CalibrationSession(CELL, STEADINESS)
    with pytest.raises(CalibrationError, match='infeed eye is blocked'):
        session.begin(0.0, 0.0, [BLOCKED])
    session.begin(0.0, 0.0, [CLEAR])
    assert session.add(block(0, 1000), 0.0) is None
    with pytest.raises(CalibrationError, match='infeed eye has switched'):
        session.add(BLOCKED, 0.0)
    assert session.points == []


def test_a_gap_between_blocks_counts_as_samples_lost():
    session = CalibrationSession(CELL, STEADINESS)
    session.begin(0.0, 0.0, ())
    numbers = (*range(7), *range(8, 25))
    readings = [session.add(block(number, 1000), 0.0) for number in numbers]
    # The seven before it do not count: the first reading is ten blocks after the gap.
    first = readings.index(found(readings))
    assert first - 7 >= 9


def test_the_points_make_a_calibration_when_nothing_passes():
    session = CalibrationSession(CELL, STEADINESS)
    with pytest.raises(CalibrationError, match='no load was read'):
        session.finish(0.0, (), 0, 0.0)
    fed(session, 0.0, 0.0)
    fed(session, 0.5, 0.5)
    edges, soon, later = (CLEAR,), NANOSECONDS, 3 * NANOSECONDS
    with pytest.raises(CalibrationError, match='wait until nothing passes'):
        session.finish(0.0, edges, soon, 0.0)
    with pytest.raises(CalibrationError, match='more than 60 min ago'):
        session.finish(0.0, edges, later, 3601.0)
    calibration = session.finish(1e-6, edges, later, 1.0)
    assert calibration.counts_per_kg == pytest.approx(SENSITIVITY, rel=1e-12)
    assert calibration.zero_counts == pytest.approx(1000, abs=1e-6)


def test_masses_that_contradict_each_other_are_refused():
    session = CalibrationSession(CELL, STEADINESS)
    for mass, said in ((0.0, 0.0), (0.5, 0.5), (1.0, 1.002)):  # the last one is 2 g too heavy
        fed(session, mass, said)
    with pytest.raises(CalibrationError, match='the largest residual is'):
        session.finish(1e-4, (), 0, 0.0)
    assert session.finish(0.0, (), 0, 0.0).largest_residual > 1e-4
