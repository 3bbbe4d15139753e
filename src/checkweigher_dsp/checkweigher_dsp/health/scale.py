# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings on the scale: its zero and the noise of the empty belt."""

import math

import numpy as np

from checkweigher_core.health.findings import (
    MINUTE,
    Finding,
    RecentValues,
    conclude,
    error_if,
    warn_if,
)
from checkweigher_core.records import GRAMS
from checkweigher_dsp.segmentation.zero_tracking import Zero
from checkweigher_dsp.signal import Array

_HOUR = 3600.0  # one hour in s
_DRIFT_SPAN = 1800.0  # longest period in s over which the drift is measured
_DRIFT_PERIOD = 10.0  # interval in s between two readings of the zero for the drift.
# Shortest period in s over which the drift is measured. In a shorter period, noise may look like a
# drift.
_SHORTEST_DRIFT = 300.0
_WARM_UP = 1800.0  # warm-up time of a load cell in s
_STEP = 5.0  # smallest change of the zero that counts as sudden, in standard deviations
_NEAR_LIMIT = 0.75  # fraction of zero_range above which a warning is given.
# Time in s without an update of the zero while products pass, above which a warning is given.
_UPDATE_PATIENCE = 120.0
# Length of the FFT in samples. A shorter segment is padded with zeros. Of a longer segment, only
# the end is used.
_FFT_LENGTH = 1024
_FEWEST_SAMPLES = 64  # minimum number of samples of a segment of the empty belt
_LOWEST_FREQUENCY = 2.0  # lowest frequency of vibration in Hz; a drift is slower
_RECENT_SEGMENTS = 5  # number of latest segments for the current noise and its spectrum
_USUAL_SEGMENTS = 300  # maximum number of segments whose median noise is the usual noise
_FEWEST_USUAL = 20  # minimum number of segments from which the usual noise is computed
_NOISY = 3.0  # ratio to the usual noise above which a warning is given


class ZeroWatch:
    """Statistics of the zero: its distance from the zero of calibration, and its drift.

    `zero_range` is the largest permitted distance from the zero of calibration in kg, or 0 if the
    distance is not checked. `began` is the time in s at which the node was started. `usual_drift`
    is the standard deviation of the drift in kg/s. If `usual_drift` is infinite, no change of the
    zero counts as sudden.
    """

    def __init__(
        self,
        counts_per_kg: float,
        zero_counts: float,
        zero_range: float,
        began: float,
        usual_drift: float = math.inf,
    ) -> None:
        self._counts_per_kg = counts_per_kg
        self._zero_counts = zero_counts
        self._range = zero_range
        self._began = began
        self._usual_drift = usual_drift
        self._moved = 0.0, -math.inf  # latest sudden change of the zero in kg, and its time in s
        self._uncertain = math.inf  # standard deviation in kg of the latest reading for the drift
        self._zero = Zero(math.nan, math.nan)
        self._updated = math.nan
        self._item = -math.inf
        # Time in s of the first product since the last change of the zero, or infinity if no
        # product has passed since then.
        self._missed_since = math.inf
        self._drift = RecentValues(_DRIFT_SPAN)
        self._noted = -math.inf

    def add(self, now: float, zero: Zero, *, item: bool) -> None:
        """Add the zero at `now` in s. `item` is true if an item passes at this time."""
        if zero.counts != self._zero.counts:  # The initial zero is NaN, so the first zero differs.
            self._updated, self._missed_since = now, math.inf
        elif item:
            self._missed_since = min(self._missed_since, now)
        self._zero = zero
        if now - self._noted >= _DRIFT_PERIOD:
            self._look_for_step(now)
            self._drift.add(now, self._distance)
            self._noted = now
        if item:
            self._item = now

    def set(self) -> None:
        """Discard the readings for the drift, because a person has set the zero.

        A zero that a person has set counts neither as a sudden change nor as a drift.
        """
        self._noted = -math.inf
        self._drift.clear()

    def _look_for_step(self, now: float) -> None:
        """Record the change of the zero since the last reading if it is too large for a drift."""
        before, self._uncertain = self._uncertain, self._zero.std_dev / abs(self._counts_per_kg)
        if not self._drift:
            return
        step = self._distance - self._drift[-1][1]
        usual = self._usual_drift * (now - self._noted)
        if abs(step) > _STEP * (usual + before + self._uncertain):
            self._moved = step, now

    @property
    def _distance(self) -> float:
        return (self._zero.counts - self._zero_counts) / self._counts_per_kg

    @property
    def drift(self) -> float:
        """Drift of the zero in kg/h, or NaN if the readings cover less than 5 minutes."""
        return _HOUR * self._drift.slope if self._drift.span >= _SHORTEST_DRIFT else math.nan

    def finding(self, now: float) -> Finding:
        """Return the finding on the zero and its drift (aspect Zero)."""
        self._drift.forget(now)
        distance, drift = self._distance, self.drift
        share = abs(distance) / self._range if self._range > 0 else math.nan
        step = self._moved[0] if now - self._moved[1] < MINUTE else 0.0
        values = {
            'from_calibration_g': GRAMS * distance,
            'std_dev_g': GRAMS * self._zero.std_dev / abs(self._counts_per_kg),
            'share_of_zero_range': share,
            'drift_g_per_h': GRAMS * drift,
            'age_of_last_update_s': now - self._updated,
            'running_for_min': (now - self._began) / MINUTE,
        }
        concerns = [
            error_if(
                not self._zero.trusted,
                'the empty belt reads another zero than the one in use, or one outside zero_range',
                'clean the belt, free the platform, then set the zero or calibrate',
            ),
            warn_if(
                step > 0,
                f'the zero has risen by {GRAMS * step:.1f} g at once',
                'look whether something lies on the belt; if not, the load cell has shifted: set '
                'the zero',
            ),
            warn_if(
                step < 0,
                f'the zero has fallen by {-GRAMS * step:.1f} g at once',
                'look whether something was taken off; if not, the load cell has shifted: set the '
                'zero',
            ),
            warn_if(
                share > _NEAR_LIMIT,
                f'the zero has used {100 * share:.0f} % of zero_range',
                'clean the belt; calibrate if it is clean',
            ),
            warn_if(
                self._range > 0 and abs(distance + drift) > self._range,
                f'the zero drifts by {GRAMS * drift:+.1f} g/h and leaves zero_range in an hour',
                'check whether dirt builds up on the belt'
                if now - self._began > _WARM_UP
                else 'let the load cell warm up',
            ),
            warn_if(
                self._item - self._missed_since > _UPDATE_PATIENCE,
                f'products have passed for {now - self._missed_since:.0f} s without a new zero',
                'increase the spacing of the products or decrease settle_time',
            ),
        ]
        return conclude('Zero', f'{GRAMS * distance:+.2f} g from calibration', concerns, values)


class BeltNoiseWatch:
    """Statistics of the noise of the empty belt, with the strongest frequency of the noise.

    `limit` is the largest permitted standard deviation of the noise in kg. If `limit` is 0, the
    noise is only compared with the usual noise.
    """

    def __init__(self, sample_rate: float, limit: float) -> None:
        self._rate = sample_rate
        self._limit = limit
        self._recent = RecentValues(10 * MINUTE, _RECENT_SEGMENTS)
        self._usual = RecentValues(_HOUR, _USUAL_SEGMENTS)
        self._power = np.zeros(_FFT_LENGTH // 2 + 1)
        self._memory = 1.0 - 1.0 / _RECENT_SEGMENTS

    def add(self, now: float, force: Array) -> None:
        """Add a segment of the empty belt, an array (n,) in kg.

        A segment of fewer than 64 samples is ignored.
        """
        if len(force) < _FEWEST_SAMPLES:
            return
        force = force[-_FFT_LENGTH:]
        force = force - force.mean()
        noise = float(force.std())
        self._recent.add(now, noise)
        self._usual.add(now, noise)
        power = np.abs(np.fft.rfft(force * np.hanning(len(force)), _FFT_LENGTH)) ** 2
        self._power = self._memory * self._power + power / len(force)

    @property
    def frequency(self) -> float:
        """Frequency in Hz of the strongest spectral line at or above 2 Hz, or NaN without noise."""
        lowest = math.ceil(_LOWEST_FREQUENCY * _FFT_LENGTH / self._rate)
        if not self._power[lowest:].any():
            return math.nan
        return (lowest + int(np.argmax(self._power[lowest:]))) * self._rate / _FFT_LENGTH

    def finding(self, now: float) -> Finding:
        """Return the finding on the noise of the empty belt (aspect Belt noise)."""
        self._recent.forget(now)
        self._usual.forget(now)
        noise, frequency = self._recent.median, self.frequency
        usual = self._usual.median if len(self._usual) >= _FEWEST_USUAL else math.nan
        values = {
            'std_dev_g': GRAMS * noise,
            'usual_std_dev_g': GRAMS * usual,
            'strongest_frequency_hz': frequency,
        }
        well = 'not known yet' if math.isnan(noise) else f'{GRAMS * noise:.2f} g'
        ratio = noise / usual if usual else math.inf
        hint = f'strongest at {frequency:.1f} Hz: check rollers, belt joint, motor and floor'
        concerns = [
            warn_if(
                self._limit > 0 and noise > self._limit,
                f'{well}, above max_belt_noise of {GRAMS * self._limit:.2f} g',
                hint,
            ),
            warn_if(
                noise > _NOISY * usual and len(self._recent) == _RECENT_SEGMENTS,
                f'{well}, {ratio:.1f} times the usual noise',
                hint,
            ),
        ]
        return conclude('Belt noise', well, concerns, values)
