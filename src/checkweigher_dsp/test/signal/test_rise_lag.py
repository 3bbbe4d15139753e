# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The lag of a rise, against what the theory of the platform and of a bent rise says."""

import math

import numpy as np
from numpy.typing import NDArray
import pytest

from checkweigher_dsp.denoising.load_rise import load_response, load_share
from checkweigher_dsp.signal.rise_lag import RiseLag, rise_lag

RATE = 960.0
TIME = np.arange(-0.35, 0.6, 1 / RATE)
MASS, RISE, TRANSIT = 0.15, 0.2, 0.4
MS = 1e-3


def seen(force: NDArray[np.float64], begin: float = -0.35, rise: float = RISE) -> RiseLag:
    """Return what is seen of a signal over TIME from `begin` up to t3."""
    used = (begin <= TIME) & (TIME < TRANSIT)
    return rise_lag(force[used], TIME[used], rise, TRANSIT)


# By up to more than the eyes show the level, after the longer rise.
@pytest.mark.parametrize(
    ('shift', 'rise'),
    [*[(each, RISE) for each in (-60, -15, -2, 0, 1, 15, 60)], (-150, 0.32), (-90, 0.32)],
)
def test_a_rise_that_is_late_or_early_lags_by_that(shift: int, rise: float):
    # The fall follows it.
    fall = load_share(TIME - TRANSIT - MS * shift, rise)
    found = seen(MASS * (load_share(TIME - MS * shift, rise) - fall), rise=rise)

    assert found.lag == pytest.approx(MS * shift, abs=2e-5)
    assert 0 < found.std_dev < 1e-3
    if abs(shift) < 15:
        assert found.bend.lag == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize('frequency', [22.0, 38.0, 45.0])
def test_a_platform_lags_by_its_delay_at_frequency_0(frequency: float):
    force = MASS * load_response(TIME, RISE, frequency, 0.06)
    assert seen(force).lag == pytest.approx(2 * 0.06 / (2 * math.pi * frequency), abs=1e-4)


def test_a_low_pass_lags_by_its_delay_at_frequency_0():
    step = 0.25
    delay = (1 / step - 1) / RATE
    force, state = np.zeros(len(TIME)), 0.0
    for index, share in enumerate(load_share(TIME, RISE)):
        state += step * (share - state)
        force[index] = MASS * state

    assert seen(force).lag == pytest.approx(delay, abs=2e-5)


@pytest.mark.parametrize('bend', [-0.4, 0.5])
def test_a_load_that_does_not_come_on_evenly_has_a_lag_that_is_all_bend(bend: float):
    share = load_share(TIME, RISE)
    found = seen(MASS * (share - bend * share * (1 - share)))
    assert found.lag == pytest.approx(bend * RISE / 6, rel=0.02)
    assert found.bend.lag == pytest.approx(bend * RISE / 6, rel=0.2)  # exact for small ones


def test_the_unit_and_the_zero_do_not_matter():
    force = MASS * load_response(TIME, RISE, 38.0, 0.06)
    assert seen(5e5 * force + 1.25e6).lag == pytest.approx(seen(force).lag, abs=1e-9)


def test_the_stated_standard_deviation_is_that_of_the_lags():
    random = np.random.default_rng(3)
    lines = [2 * math.pi * frequency * TIME for frequency in (9.0, 26.0)]
    found = []
    for _ in range(200):
        force = MASS * load_share(TIME, RISE) + 5e-4 * random.standard_normal(len(TIME))
        for line in lines:
            force += 1e-3 * np.sin(line + random.uniform(0, 2 * math.pi))
        found.append(seen(force))
    scatter = float(np.std([each.lag for each in found]))
    stated = math.sqrt(float(np.mean([each.std_dev**2 for each in found])))

    assert scatter == pytest.approx(stated, rel=0.35)
    assert np.mean([abs(each.lag) > 4 * each.std_dev for each in found]) < 0.02


@pytest.mark.parametrize('begin', [-0.05, 0.0, 0.1])
def test_without_enough_of_empty_belt_nothing_is_known(begin: float):
    assert not seen(MASS * load_share(TIME, RISE), begin).is_known


def test_without_a_load_nothing_is_known():
    assert not seen(np.zeros(len(TIME))).is_known
    assert not seen(-MASS * load_share(TIME, RISE)).is_known
