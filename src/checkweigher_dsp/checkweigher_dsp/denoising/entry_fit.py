# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Correction of the times t1 and t2 at which a product enters, by a fit to the signal.

Polled photo-eyes measure t1 and t2 with an error of about a millisecond. If the load is removed
from the signal at a wrong time, an error as long as the rise of the load remains. A low-pass filter
cannot distinguish the error due to a wrong time from a load. But the shape of the error is known,
so the size of the error can be fitted to the signal (own derivation):

.. math:: y - M r = m\, r + M \delta_1 \frac{\partial r}{\partial t_1}
   + M \delta_2 \frac{\partial r}{\partial t_2} + n,\quad \delta_i \sim N(0, u^2 / 3)

y is the signal, r the response of the platform to a load of 1, M the approximate load, m the
unknown true load minus M, and n the disturbance. delta_1 and delta_2 are the true values of t1 and
t2 minus the values measured by the photo-eyes. The variance u^2 / 3 of delta_1 and delta_2 is the
variance of a uniform distribution between -u and u, where u is the largest error of the photo-eyes.
All signals of the fit are block means. A prediction-error filter makes the disturbance n white.
"""

import math

import numpy as np

from checkweigher_dsp.denoising.extrapolation import block_means
from checkweigher_dsp.denoising.load_rise import block_responses
from checkweigher_dsp.denoising.window_batch import WindowBatch
from checkweigher_dsp.signal import Array

# Minimum number of filtered samples for the fit of the unknowns m, delta_1 and delta_2.
_LEAST_SAMPLES = 8
# Number of rounds of the fit. The variance of the disturbance n is estimated in the first round
# from the component of y - M r that is orthogonal to r, and in the second round from the residual.
_ROUNDS = 2
_FURTHEST = 2.0  # largest shift of an edge as a multiple of its uncertainty


class EntryFit:
    """Fit of the times t1 and t2 to the signal of each window of a batch.

    `uncertainty` u, above 0, is the largest error of t1 and t2 in s. `level`, (windows, 1), is the
    approximate load M in kg. The natural frequency in Hz and the damping ratio, (windows, 1), are
    those of the platform with the load.
    """

    def __init__(
        self,
        batch: WindowBatch,
        uncertainty: float,
        level: Array,
        natural_frequency: Array,
        damping_ratio: Array,
    ) -> None:
        self._batch = batch
        self._uncertainty = uncertainty
        blocks = block_means(batch.force, batch.block)
        count = blocks.shape[-1]
        self._rows = np.zeros((len(blocks), 4, count))
        self._platform_taps = np.empty((0, 3))
        if count < _LEAST_SAMPLES:
            return
        # Number of blocks without a load, which end before the entry. The blocks are counted back
        # from t3, where the last one ends.
        empty = max((batch.entry - batch.force.shape[-1]) // batch.block + count, 0)
        interval = batch.time[:, 1:2] - batch.time[:, :1]
        width = batch.block * interval
        bounds = batch.time[:, -1:] + interval / 2 - width * np.arange(count - empty, -1, -1)
        responses = block_responses(bounds, batch.rise_time, natural_frequency, damping_ratio)
        self._rows[:, 0, empty:] = responses[0]
        responses *= level
        self._rows[:, 1] = blocks
        self._rows[:, 1, empty:] -= responses[0]
        self._rows[:, 2:, empty:] = responses[1:].swapaxes(0, 1)
        self._platform_taps = platform_taps(width, natural_frequency, damping_ratio)

    def times(self, taps: Array | None) -> tuple[Array, Array]:
        """Return the time of each sample since the corrected t1, and the corrected rise time, in s.

        The times are (windows, n), and the rise time t2 - t1 is (windows, 1). See `shift` for
        `taps`.
        """
        shift, batch = self.shift(taps), self._batch
        t1, t2 = shift[:, :1], shift[:, 1:]
        return batch.time - t1, batch.rise_time + t2 - t1

    def shift(self, taps: Array | None) -> Array:
        """Estimate the corrections delta_1 of t1 and delta_2 of t2 in s, (windows, 2).

        The estimates are limited to twice the uncertainty u. Both corrections are 0 if there are
        too few block means, or if the signal does not determine them. `taps`, (windows, p + 1), are
        prediction-error filters for the block means of the disturbance. If `taps` is None or p is
        0, filters for a platform under white-noise forces are used.
        """
        shift = np.zeros((len(self._rows), 2))
        filters = self._platform_taps if taps is None or taps.shape[-1] == 1 else taps
        for number, (rows, own) in enumerate(zip(self._rows, filters, strict=False)):
            if rows.shape[-1] - len(own) + 1 >= _LEAST_SAMPLES:
                # Filter all rows in one call, and discard the outputs that mix two rows.
                white = np.convolve(rows.ravel(), own)[: rows.size].reshape(rows.shape)
                shift[number] = _fit(white[:, len(own) - 1 :], self._uncertainty)
        return shift


def platform_taps(interval: Array, natural_frequency: Array, damping_ratio: Array) -> Array:
    """Return filters, (windows, 3), that whiten the motion of platforms under white-noise forces.

    The sampling interval in s, the natural frequency in Hz and the damping ratio are (windows, 1).

    Examples
    --------
    >>> column = np.ones((1, 1))
    >>> platform_taps(column / 240, 38.0 * column, 0.06 * column).round(3).tolist()
    [[1.0, -1.029, 0.887]]
    """
    taps = np.ones((len(interval), 3))
    angle = 2 * np.pi * natural_frequency * interval
    shrink = np.exp(-damping_ratio * angle)
    taps[:, 1:2] = -2 * shrink * np.cos(angle * np.sqrt(1 - np.square(damping_ratio)))
    taps[:, 2:] = shrink * shrink
    return taps


def _fit(white: Array, uncertainty: float) -> tuple[float, float]:
    """Estimate delta_1 and delta_2 in s, which are 0 if the signal does not determine them.

    The rows of `white`, (4, count), are r, y - M r, and the derivatives of M r with respect to t1
    and t2. All rows are filtered, so that the disturbance n is white. `uncertainty` is u in s.
    """
    # Use floats, because arithmetic on arrays of two numbers takes many times as long.
    (size, *shares), (_, power, *seen), (_, _, *first), (*_, last) = white.dot(white.T).tolist()
    if not size > 0:
        return 0.0, 0.0
    # Use only the part of each signal that is orthogonal to the response, because the error m of
    # the load has no prior distribution.
    signal, one, two = (share / size for share in shares)
    power -= signal * shares[0]
    b1, b2 = seen[0] - signal * shares[1], seen[1] - signal * shares[2]
    a11, a12, a22 = first[0] - one * shares[1], first[1] - one * shares[2], last - two * shares[2]
    left, shift1, shift2 = power, 0.0, 0.0
    for _ in range(_ROUNDS):
        ridge = max(left, 0.0) / white.shape[-1] * 3 / uncertainty / uncertainty
        determinant = (a11 + ridge) * (a22 + ridge) - a12 * a12
        if not 0 < determinant < math.inf:
            return 0.0, 0.0
        shift1 = ((a22 + ridge) * b1 - a12 * b2) / determinant
        shift2 = ((a11 + ridge) * b2 - a12 * b1) / determinant
        left = (
            power
            - 2 * (shift1 * b1 + shift2 * b2)
            + a11 * shift1 * shift1
            + 2 * a12 * shift1 * shift2
            + a22 * shift2 * shift2
        )
    limit = _FURTHEST * uncertainty
    return min(max(shift1, -limit), limit), min(max(shift2, -limit), limit)
