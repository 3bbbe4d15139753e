# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A zero that wanders off, and a belt that begins to shake."""

import math

import numpy as np
import pytest

from checkweigher_core.health.findings import Level
from checkweigher_dsp.health.scale import BeltNoiseWatch, ZeroWatch
from checkweigher_dsp.segmentation.zero_tracking import Zero

COUNTS_PER_KG = -5e5  # a cell that is mounted upside down


def zero_watch():
    return ZeroWatch(COUNTS_PER_KG, 1000.0, 0.3, 0.0)


def zero_of(mass, *, trusted=True):
    return Zero(1000.0 + COUNTS_PER_KG * mass, 5.0, trusted)


@pytest.mark.parametrize(
    ('mass', 'trusted', 'level'),
    [(0.1, True, Level.OK), (-0.24, True, Level.WARN), (0.31, False, Level.ERROR)],
)
def test_the_zero_is_judged_by_its_share_of_the_range(mass, trusted, level):
    watch = zero_watch()
    watch.add(1.0, zero_of(mass, trusted=trusted), item=True)
    finding = watch.finding(3.0)
    assert finding.level == level
    assert finding.values['from_calibration_g'] == pytest.approx(1e3 * mass, rel=1e-9)
    assert finding.values['share_of_zero_range'] == pytest.approx(abs(mass) / 0.3, rel=1e-9)
    assert finding.values['std_dev_g'] == pytest.approx(0.01, rel=1e-9)
    assert finding.values['age_of_last_update_s'] == 2.0


@pytest.mark.parametrize(
    ('masses', 'std_devs', 'text'),
    [
        ((0.0, 0.003), (5, 5), 'the zero has risen by 3.0 g at once'),
        ((0.003, 0.0), (5, 5), 'the zero has fallen by 3.0 g at once'),
        ((0.0, 0.0005), (5, 5), ''),  # as much as it drifts in this time
        ((0.0, 0.003), (2500, 5), ''),  # 5 g: the first zero after a start
    ],
)
def test_a_zero_that_changes_at_once_is_told_for_a_minute(masses, std_devs, text):
    watch = ZeroWatch(COUNTS_PER_KG, 1000.0, 0.3, 0.0, usual_drift=2e-5)
    for number, (mass, std_dev) in enumerate(zip(masses, std_devs, strict=True)):
        watch.add(10.0 * number, Zero(1000.0 + COUNTS_PER_KG * mass, std_dev), item=True)
    assert watch.finding(60.0).text.startswith(text)
    assert watch.finding(60.0).level == (Level.WARN if text else Level.OK)
    assert watch.finding(71.0).level == Level.OK


def test_a_zero_that_a_person_sets_is_not_told():
    watch = ZeroWatch(COUNTS_PER_KG, 1000.0, 0.3, 0.0, usual_drift=2e-5)
    watch.add(0.0, zero_of(0.0), item=True)
    watch.set()
    watch.add(10.0, zero_of(0.02), item=True)
    watch.add(20.0, zero_of(0.02), item=True)
    assert watch.finding(20.0).level == Level.OK


@pytest.mark.parametrize(('per_hour', 'level'), [(0.1, Level.OK), (-0.4, Level.WARN)])
def test_a_drift_is_warned_of_if_it_uses_the_range_up_in_an_hour(per_hour, level):
    watch = zero_watch()
    for second in range(0, 600, 2):
        watch.add(second, zero_of(per_hour * second / 3600), item=True)
        if second < 300:
            assert math.isnan(watch.drift)
    finding = watch.finding(600.0)
    assert finding.values['drift_g_per_h'] == pytest.approx(1e3 * per_hour, rel=1e-6)
    assert finding.level == level
    if level == Level.WARN:
        assert finding.hint == 'let the load cell warm up'


def test_products_without_a_reading_of_the_empty_belt_are_warned_of():
    watch = zero_watch()
    for second in range(130):
        watch.add(second, zero_of(0.0), item=True)
    assert 'spacing' in watch.finding(130.0).hint
    watch.add(131.0, zero_of(1e-6), item=True)
    assert watch.finding(131.0).level == Level.OK
    for second in range(132, 732):  # an idle line needs none
        watch.add(second, zero_of(0.0), item=False)
    assert watch.finding(732.0).level == Level.OK


def shaking(amplitude, frequency=24.0, *, rate=960.0, samples=480):
    """Return a sine with a standard deviation of amplitude / sqrt(2), kg."""
    return 0.1 + amplitude * np.sin(2 * np.pi * frequency * np.arange(samples) / rate)


def test_noise_and_its_frequency_are_those_of_the_signal():
    watch = BeltNoiseWatch(960.0, 0.0)
    watch.add(0.0, shaking(0.002))
    finding = watch.finding(0.0)
    assert finding.values['std_dev_g'] == pytest.approx(2 / math.sqrt(2), rel=1e-9)
    assert finding.values['strongest_frequency_hz'] == pytest.approx(24.0, abs=960.0 / 1024)
    assert finding.level == Level.OK


def test_a_segment_of_few_samples_is_passed_over():
    watch = BeltNoiseWatch(960.0, 0.001)
    watch.add(0.0, shaking(1.0, samples=63))
    assert watch.finding(0.0).text == 'not known yet'


def test_noise_above_the_parameter_or_its_own_past_is_warned_of():
    limited = BeltNoiseWatch(960.0, 0.001)
    limited.add(0.0, shaking(0.002))
    assert limited.finding(0.0).level == Level.WARN
    watch = BeltNoiseWatch(960.0, 0.0)
    for second in range(60):
        watch.add(second, shaking(0.001))
    for second in range(60, 63):
        assert watch.finding(second).level == Level.OK  # two segments may be an accident
        watch.add(second, shaking(0.004, 9.0))
    finding = watch.finding(63.0)
    assert finding.level == Level.WARN
    assert finding.text.endswith('4.0 times the usual noise')
    assert 'strongest at 9.4 Hz' in finding.hint  # 9 Hz on a grid of 0.94 Hz
    for second in range(63, 66):
        watch.add(second, shaking(0.001))
    assert watch.finding(66.0).level == Level.OK


def test_noise_on_a_belt_that_had_none_is_warned_of():
    watch = BeltNoiseWatch(960.0, 0.0)
    for second in range(63):
        watch.add(second, np.zeros(480) if second < 60 else shaking(0.001))
    assert watch.finding(63.0).level == Level.WARN
