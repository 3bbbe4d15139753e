# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reject stations and sorting zones: which item goes where, and when it has to be told."""

from dataclasses import replace
import math

import pytest

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    Item,
    MassEstimate,
    Verdict,
)
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.rejection.stations import route

MS = NANOSECONDS // 1000
T3 = 1000 * NANOSECONDS
PARAMETERS = RejectParameters(
    lower_limit=0.1,
    upper_limit=0.2,
    stations='MetalDetected; UNDER OVER; 0.150..0.155 0.160..0.165',
    station_distances=(0.8, 1.4, 0.3),
    station_delays=(0.01, 0.0, 0.02),
)


def routed(
    decision: Decision, *reasons: str, mass: float = math.nan, speed: float = 2.0
) -> Verdict:
    verdict = Verdict(1, T3, decision, reasons, mass=mass, reject_at=T3 + 250 * MS)
    return route(verdict, PARAMETERS.all_stations, speed)


@pytest.mark.parametrize(
    ('decision', 'reasons', 'mass', 'station', 'ms'),
    [
        (Decision.FAULT, ('MetalDetected',), 0.15, 1, 400 - 10),  # 0.8 m at 2 m/s
        (Decision.UNDER, (), 0.05, 2, 700),
        (Decision.OVER, (), 0.3, 2, 700),
        (Decision.ACCEPT, (), 0.150, 3, 150 - 20),
        (Decision.ACCEPT, (), 0.1649, 3, 130),
        (Decision.ACCEPT, (), 0.155, 0, None),  # the upper end belongs to the next range
        (Decision.FAULT, ('NoLoad',), math.nan, 0, None),
        (Decision.FAULT, ('DistanceFault', 'MetalDetected'), math.nan, 0, None),  # where is it?
    ],
)
def test_an_item_goes_to_the_first_station_that_takes_it(
    decision: Decision, reasons: tuple[str, ...], mass: float, station: int, ms: int | None
):
    verdict = routed(decision, *reasons, mass=mass)

    assert verdict.station == station
    assert verdict.station_at == (None if ms is None else T3 + ms * MS)
    assert verdict.reject_at == T3 + 250 * MS  # that of the rejector, in any case


def test_an_item_of_unknown_place_goes_to_the_rejector():
    assert routed(Decision.UNDER, speed=math.nan).station == 0
    nowhere = replace(routed(Decision.UNDER), t3=None, station=0, station_at=None)
    assert route(nowhere, PARAMETERS.all_stations, 2.0).station == 0


def stage_with_an_item(parameters: RejectParameters) -> RejectStage:
    """Return a stage with an item at 2 m/s, whose t3 is 250 ms after `T3`."""
    stage = RejectStage(parameters, 0.5)
    for ms, eye in ((0, Eye.INFEED), (50, Eye.INFEED), (250, Eye.OUTFEED)):
        stage.take(EyeEdge(T3 + ms * MS, eye, ms != 50), T3 + ms * MS)
    stage.take(Item(T3, 1, 1, T3, T3 + 50 * MS, T3 + 250 * MS, 2.0, True), T3 + 250 * MS)
    return stage


def test_the_verdict_comes_in_time_for_the_station_nearest_to_the_scale():
    stage = stage_with_an_item(PARAMETERS)

    # At the third station, 0.3 m on, at 400 ms; told 20 ms before, the verdict 50 ms before that.
    assert stage.due == T3 + 330 * MS
    (verdict,) = stage.advance(T3 + 330 * MS)
    assert verdict.reasons == ('NoEstimate',)


def test_a_verdict_that_is_too_late_for_its_station_is_late():
    stage = stage_with_an_item(replace(PARAMETERS, station_distances=(0.8, 0.3, 1.4)))
    t1, t2, t3 = (T3 + ms * MS for ms in (0, 50, 250))
    light = MassEstimate(1, t1, t2, t3, (), 0.05, 1e-4, belt_speed=2.0, line_speed=2.0)
    (verdict,) = stage.take(light, T3 + 401 * MS)  # due at the station at 400 ms, else at 500 ms

    assert (verdict.decision, verdict.station, verdict.late) == (Decision.UNDER, 2, True)
