# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Agreement of samples and photo-eyes in the diagnostics."""

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_dsp.health.segmenter import edges_finding
from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import Bend, RiseLag

STATED = SegmenterParameters().rise_lag


def check_of(*lags: float | None, **parameters: bool) -> EdgeCheck:
    """Return the check of items that lag by so much more than is stated, s; None is not seen."""
    check = EdgeCheck(SegmenterParameters(**parameters))
    for lag in lags:
        seen = RiseLag() if lag is None else RiseLag(STATED + lag, 1e-4, lambda: Bend(0.0, 1e-3))
        check.check(seen, 1.0, 0.1)
    return check


@pytest.mark.parametrize(
    'lags', [(), (0.0,), (0.0005, -0.0003) * 10, (*[0.0] * 10, 0.004, 0.0, 0.0)]
)
def test_eyes_and_samples_that_agree_are_well(lags: tuple[float, ...]):
    assert edges_finding(check_of(*lags)).level is Level.OK


@pytest.mark.parametrize(('change', 'side'), [(0.002, 'later'), (-0.015, 'earlier')])
def test_a_lasting_change_is_an_error(change: float, side: str):
    finding = edges_finding(check_of(*[0.0] * 25, *[change] * 8))

    assert finding.level is Level.ERROR
    assert side in finding.text
    assert finding.values['change_ms'] == pytest.approx(1e3 * change)


@pytest.mark.parametrize(
    ('lag', 'level'),
    [(0.005, Level.WARN), (0.04, Level.ERROR)],  # the latter is too large to be learned
)
def test_a_lag_that_is_not_stated_asks_to_be_measured(lag: float, level: Level):
    finding = edges_finding(check_of(*[lag] * 10))

    assert finding.level is level
    assert f'{1e3 * lag:.1f} ms' in finding.text
    assert 'dynamic' in finding.hint
    assert edges_finding(check_of(*[0.0] * 10, rise_lag_known=True)).level is Level.OK


def test_items_whose_rise_is_not_seen_are_confirmed_by_nothing():
    assert edges_finding(check_of(*[None] * 10)).level is Level.WARN
    assert edges_finding(check_of(*[None] * 4, *[0.0] * 10)).level is Level.OK
