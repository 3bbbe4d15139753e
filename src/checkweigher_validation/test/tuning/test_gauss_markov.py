# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learned model of a simulated machine, compared with the machine."""

from dataclasses import replace
import math

from known_groups import groups_of
import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.gauss_markov import GaussMarkovParameters
from checkweigher_recording.simulation.simulator import DAMPING_RATIO, IMPACT_DURATION, PROFILES
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.gauss_markov import fit_noise, fit_platform
from checkweigher_validation.tuning.tunables import TuningError

FREQUENCY = 0.02  # relative
DAMPING = 0.3  # relative
RATE = 960.0
KNOWN = GaussMarkovParameters(sample_rate=RATE)


def simulated(profile, *speeds, count=40, **others):
    return groups_of(*speeds, profile=profile, count=count, seed=5, **others)


def check_platform(found, profile):
    frequency = PROFILES[profile].natural_frequency
    assert found.natural_frequency == pytest.approx(frequency, rel=FREQUENCY)
    assert found.damping_ratio == pytest.approx(DAMPING_RATIO, rel=DAMPING)


# At 0.5 m/s there is more of the empty belt than is used, at 1.5 m/s less.
@pytest.mark.parametrize(
    ('profile', 'speeds'), [('quiet', (1.0,)), ('paper', (0.5, 1.5)), ('soft', (1.0,))]
)
def test_the_platform_is_found(profile, speeds):
    found = fit_platform(simulated(profile, *speeds), KNOWN)
    check_platform(found, profile)
    # The simulated load comes on evenly from eye to eye.
    assert abs(found.entry_begin) < 1e-3
    assert abs(found.entry_end) < 1e-3


def test_the_platform_is_found_where_the_belt_is_empty_for_ten_samples_only():
    groups = simulated('paper', 1.0, spacing=0.31)
    check_platform(fit_platform(groups, KNOWN), 'paper')


@pytest.mark.filterwarnings('error')
def test_a_belt_that_is_never_empty_has_a_model_too():
    groups = simulated('paper', 1.0, spacing=0.301, count=20, lead_in=0.0)
    found = fit_platform(groups, KNOWN)
    reflections, std_dev, _ = fit_noise(groups[0], found, 20)
    assert found.natural_frequency > 0
    assert np.all(abs(reflections) < 1)
    assert std_dev > 0


def test_what_a_quiet_machine_leaves_is_the_noise_of_its_electronics():
    groups = simulated('quiet', 1.0)
    model = fit_platform(groups, KNOWN)
    _, std_dev, impact = fit_noise(groups[0], model, 20)
    assert std_dev == pytest.approx(PROFILES['quiet'].electronic, rel=0.1)
    assert impact < 1e-3


def test_the_impact_at_entry_is_that_of_the_machine(monkeypatch):
    # A half sine of height f and length T leaves an oscillation of the amplitude
    # w f |integral of sin(pi t / T) e^(i w t)| = w f (2 T / pi) cos(w T / 2) / (1 - (w T / pi)^2),
    # shared by its two phases.
    struck = replace(PROFILES['quiet'], impact=0.03)
    monkeypatch.setitem(PROFILES, 'quiet', struck)
    omega = 2 * math.pi * struck.natural_frequency
    half = omega * IMPACT_DURATION / 2
    response = omega * 2 * IMPACT_DURATION / math.pi * math.cos(half)
    amplitude = struck.impact * response / (1 - (2 * half / math.pi) ** 2)

    (group,) = simulated('quiet', 1.0, spacing=3.0)
    model = replace(KNOWN, natural_frequency=38.0, damping_ratio=DAMPING_RATIO)
    # 40 draws know a standard deviation to 11 %.
    assert fit_noise(group, model, 20)[2] == pytest.approx(amplitude / math.sqrt(2), rel=0.25)


def test_among_other_disturbances_the_impact_is_of_the_right_order():
    (group,) = simulated('paper', 1.0)
    impact = fit_noise(group, fit_platform([group], KNOWN), 40)[2]
    assert 0.011 / 4 < impact < 0.011 * 4


def test_windows_that_are_too_short_are_refused():
    groups = simulated('paper', 0.3, count=6, sample_rate=100.0, spacing=0.31, lead_in=0.1)
    with pytest.raises(TuningError, match=r'18\.0 m/min: no segment of noise is longer than 40'):
        fit_platform(groups, replace(KNOWN, sample_rate=100.0))


def test_signals_without_noise_are_refused():
    (group,) = simulated('quiet', 1.0, count=6)

    def silent(each):
        return replace(each, window=replace(each.window, counts=0 * each.window.counts))

    silence = SpeedGroup(group.speed, tuple(map(silent, group.passes)))
    with pytest.raises(TuningError, match='contain no noise'):
        fit_platform([silence], KNOWN)
