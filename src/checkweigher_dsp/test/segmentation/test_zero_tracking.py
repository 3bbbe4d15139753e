# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The zero against the scalar Kalman filter by hand."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from checkweigher_dsp.segmentation.zero_tracking import Zero, ZeroLimits, ZeroTracker

# Every reading is credited with a variance of 1e-8 of the initial one at least, which in these
# examples is up to 3e-6 of its own.
LEAST_NOISE = 1e-5
RATE = 40.0  # at which four samples are the shortest segment that is averaged


def _counts(*values):
    return np.array(values, np.int32)


def test_two_steps_of_the_filter():
    tracker = ZeroTracker(9.0, 2.0, 0.5, RATE)

    first = tracker.update(10.0, _counts(10, 12, 14, 16))

    # Halves 11 and 15, so a variance of 4^2 / 4; symmetrical weights, mean 13; gain 4 / (4 + 4).
    assert first.counts == pytest.approx(9 + 0.5 * 4, rel=LEAST_NOISE)
    assert first.std_dev == pytest.approx(math.sqrt(4 * 0.5), rel=LEAST_NOISE)

    second = tracker.update(12.0, _counts(11, 13, 11, 13))

    # Two seconds of random walk: 2 + 2 * 0.25. Halves alike; the older scatter counts 0.95.
    noise = 0.95 * 4 / (0.95 + 1)
    gain = 2.5 / (2.5 + noise)
    assert second.counts == pytest.approx(11 + gain * 1, rel=LEAST_NOISE)
    assert second.std_dev == pytest.approx(math.sqrt(2.5 * (1 - gain)), rel=LEAST_NOISE)


def test_the_ends_of_a_segment_count_less():
    zero = ZeroTracker(0.0, 1e6, 0.0, RATE).update(0.0, _counts(10, 0, 0, 0))

    # Weights sin^2(k pi / 5), k = 1 to 4, which add up to 5 / 2.
    assert zero.counts == pytest.approx(10 * math.sin(math.pi / 5) ** 2 / 2.5, rel=1e-6)


@pytest.mark.parametrize(('rate', 'settled'), [(300.0, True), (4.0, False)])
def test_a_segment_too_short_or_not_settled_counts_with_its_whole_variance(rate, settled):
    zero = ZeroTracker(0.0, 2.0, 0.0, rate).update(0.0, _counts(1, 5, 1, 5), settled)

    # Halves alike, but a variance of 4; gain 4 / (4 + 4).
    assert zero.counts == pytest.approx(3 / 2, rel=LEAST_NOISE)


def test_a_line_that_goes_through_whole_periods_in_each_half_does_not_blur_the_zero():
    tracker = ZeroTracker(0.0, 1e4, 0.0, 1000.0)
    line = np.rint(1e6 * np.sin(2 * np.pi * 50 * np.arange(200) / 1000)).astype(np.int32)

    zero = tracker.update(0.0, line + 7)

    # The side lobe of a Hann window five periods long is below 1e-3 of the line.
    assert zero.counts == pytest.approx(7, abs=1e3)
    assert zero.std_dev < 1e3


# A clock that goes back takes no uncertainty away, and none is above that of the calibration.
@pytest.mark.parametrize(
    ('later', 'counts', 'added'),
    [(4.0, [], 4 * 0.25), (4.0, [1000], 4 * 0.25), (-5.0, [], 0.0), (1e6, [], math.inf)],
)
def test_without_samples_the_zero_is_carried_on_and_grows_uncertain(later, counts, added):
    tracker = ZeroTracker(9.0, 2.0, 0.5, RATE)
    known = tracker.update(10.0, _counts(10, 12, 14, 16))

    carried = tracker.update(10.0 + later, _counts(*counts))

    assert carried.counts == known.counts
    assert carried.std_dev == pytest.approx(min(math.sqrt(known.std_dev**2 + added), 2.0))


@pytest.fixture
def steady():
    """Return a tracker that has read a zero of 0 a hundred times."""
    tracker = ZeroTracker(0.0, 10.0, 0.0, RATE)
    for second in range(100):
        tracker.update(float(second), _counts(-1, -1, 1, 1))
    return tracker


def test_a_jump_starts_the_filter_afresh(steady):
    zero = steady.update(100.0, _counts(29, 29, 31, 31))

    # Halves 2 apart, a variance of 1; afresh the gain is 100 / 101, without it about 1 / 100.
    assert zero.counts == pytest.approx(30 * 100 / 101, rel=LEAST_NOISE)
    assert zero.std_dev == pytest.approx(10 * math.sqrt(1 / 101), rel=LEAST_NOISE)


def test_a_jump_beyond_all_drift_is_believed_when_it_is_seen_again(steady):
    before = steady.zero
    doubted = steady.update(100.0, _counts(49, 49, 51, 51))
    other = steady.update(101.0, _counts(89, 89, 91, 91))
    again = steady.update(102.0, _counts(89, 89, 91, 91))

    assert [zero.trusted for zero in (before, doubted, other, again)] == [True, False, False, True]
    assert doubted.counts == before.counts
    assert again.counts == pytest.approx(90 * 100 / 101, rel=LEAST_NOISE)


def test_what_stood_on_the_belt_for_a_moment_changes_nothing(steady):
    before = steady.zero

    steady.update(100.0, _counts(49, 49, 71, 71))
    after = steady.update(101.0, _counts(-1, -1, 1, 1))

    assert after.trusted
    assert after.counts == pytest.approx(before.counts, abs=1e-9)
    assert after.std_dev < before.std_dev


def _follow_a_ramp(tracker, drift, seconds):
    """Return how far the zero is behind a ramp, and what it states, counts."""
    for second in range(seconds):
        level = drift * second
        halves = [level - 6] * 8 + [level + 6] * 8
        zero = tracker.update(float(second), _counts(*halves))
    return level - zero.counts, zero.std_dev


def test_a_drift_that_is_looked_for_leaves_no_lag():
    behind, _ = _follow_a_ramp(ZeroTracker(0.0, 1e3, 1.0, RATE), 2, 200)
    ahead, std_dev = _follow_a_ramp(ZeroTracker(0.0, 1e3, 1.0, RATE, drift=2.0), 2, 200)

    assert behind > 10  # two counts a second, for the 6 seconds that the filter averages
    assert abs(ahead) < 0.05 * behind
    assert abs(ahead) < std_dev


def test_what_is_not_seen_for_a_while_is_doubted_as_the_drift_allows():
    tracker = ZeroTracker(0.0, 1e4, 0.0, RATE, drift=2.0)
    for second in range(50):
        known = tracker.update(float(second), _counts(*[3 * second] * 8))

    carried = tracker.update(349.0, _counts())

    # The zero and its drift as a linear system, its noise integrated in small steps; the readings
    # are so sure that of the zero nothing is left to doubt, and of the drift what changed since.
    fading = np.array([[0.0, 1.0], [0.0, -1 / 600]])
    step, noise = 0.05, np.diag([0.0, 2 * 2.0**2 / 600])
    moved, doubt = expm(step * fading), np.zeros((2, 2))
    for _ in range(6000):
        doubt = moved @ doubt @ moved.T + step * noise
    assert carried.counts == pytest.approx(known.counts + 3 * 600 * (1 - math.exp(-0.5)), rel=0.02)
    assert carried.std_dev == pytest.approx(math.sqrt(doubt[0, 0]), rel=0.02)


def test_the_drift_carries_the_zero_on_no_faster_than_the_rate():
    tracker = ZeroTracker(0.0, 1e3, 1.0, RATE, ZeroLimits(rate=2.5), drift=2.0)
    _follow_a_ramp(tracker, 2, 200)
    before = tracker.zero.counts

    zero = tracker.update(200.0, _counts(*[1000] * 8))

    assert zero.counts == pytest.approx(before + 2.5)
    assert not zero.trusted


def test_after_a_jump_no_drift_is_known():
    tracker = ZeroTracker(0.0, 1e3, 1.0, RATE, drift=2.0)
    _follow_a_ramp(tracker, 2, 200)
    jumped = tracker.update(200.0, _counts(*[2000] * 8))

    assert tracker.update(201.0, _counts()).counts == pytest.approx(jumped.counts)


def test_the_zero_is_corrected_no_faster_than_the_rate():
    tracker = ZeroTracker(0.0, 1e3, 0.0, RATE, ZeroLimits(rate=2.0))
    tracker.update(0.0, _counts(0, 0, 0, 0))  # the first one is no tracking

    behind = tracker.update(3.0, _counts(500, 500, 500, 500))

    assert (behind.counts, behind.trusted) == (pytest.approx(6.0), False)
    for second in range(4, 400):
        zero = tracker.update(float(second), _counts(500, 500, 500, 500))
    assert zero.counts == pytest.approx(500, rel=1e-3)
    assert zero.trusted


@pytest.mark.parametrize(
    ('level', 'trusted'), [(99, True), (-99, True), (101, False), (-101, False)]
)
def test_a_zero_beyond_the_range_is_not_to_be_trusted(level, trusted):
    tracker = ZeroTracker(0.0, 1e3, 0.0, RATE, ZeroLimits(range=100.0))

    assert tracker.update(0.0, _counts(*[level] * 8)).trusted == trusted


def test_a_segment_that_is_not_at_rest_is_passed_over():
    tracker = ZeroTracker(9.0, 2.0, 0.0, RATE, ZeroLimits(stability=5.0))

    assert tracker.update(0.0, _counts(10, 10, 16, 16)) == Zero(9.0, 2.0)
    assert tracker.update(1.0, _counts(10, 10, 14, 14)).counts > 9.0


def test_a_segment_is_at_rest_if_all_its_parts_are():
    # At 40 Hz parts are 4 samples: both halves of this are 12.
    tracker = ZeroTracker(9.0, 2.0, 0.0, 40.0, ZeroLimits(stability=5.0))

    assert tracker.update(0.0, _counts(*[9] * 4, *[15] * 8, *[9] * 4)) == Zero(9.0, 2.0)


@pytest.mark.parametrize(('level', 'read'), [(150, True), (155, False)])
def test_a_part_that_stands_out_is_no_empty_belt(level, read):
    # At 40 Hz parts are 2 samples: means 90 and 92 in turn, half of them 2 off the median.
    counts = _counts(*[90, 90, 92, 92] * 4, level, level)

    assert (ZeroTracker(90.0, 20.0, 0.0, 40.0).update(0.0, counts) != Zero(90.0, 20.0)) is read


def test_setting_takes_the_reading_within_the_range_alone():
    tracker = ZeroTracker(0.0, 10.0, 0.0, RATE, ZeroLimits(range=100.0, rate=1e-9, stability=5.0))

    assert tracker.set(0.0, _counts(50, 50, 60, 60)) is None
    assert tracker.set(0.0, _counts(*[101] * 4)) == 101
    assert tracker.zero == Zero(0.0, 10.0)
    assert tracker.set(0.0, _counts(*[99] * 4)) == 99
    assert tracker.zero.counts == 99


def test_a_zero_that_is_set_is_as_certain_as_its_reading_is_long():
    rate, sigma = 960.0, 100.0  # Hz, counts
    noise = np.random.default_rng(5).normal(0.0, sigma, round(400 * rate)).astype(np.int32)
    tracker = ZeroTracker(0.0, 1e4, 1.0, rate)
    for number in range(20):  # gaps of 0.2 s between products
        tracker.update(float(number), noise[200 * number : 200 * number + 192])
    known = []
    for reading in noise.reshape(80, -1)[1:]:  # 5 s each
        tracker.set(100.0, reading)
        known.append((tracker.zero.counts, tracker.zero.std_dev))
    zeros, stated = np.transpose(known)
    expected = pytest.approx(sigma / math.sqrt(5 * rate), rel=0.2)
    assert np.std(zeros) == expected
    assert np.sqrt(np.mean(stated**2)) == expected
