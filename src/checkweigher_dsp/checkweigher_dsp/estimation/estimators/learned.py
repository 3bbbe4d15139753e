# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Estimator `learned`: a weighted sum of the parts of a pass, without a model of the machine.

.. math:: m = \sum_j w_j y_j,\quad w = C^{-1} s / (s' C^{-1} s)

The features y_j are the means of the signal in parts of the pass. The times before t1, from t1 to
t2 and from t2 to t3 are each divided into equal parts. So a feature corresponds to the same
position of the product on the belt at any speed and length. s is the mean curve of the training
passes for a load of 1. C is the covariance of the residuals of the training passes, combined with
the covariances of other speeds and of the empty belt. The weights are the Gauss-Markov weights for
this covariance (own derivation, see docs/method.md).
"""

from dataclasses import dataclass
from functools import partial
import math
from typing import ClassVar

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import rise_time, time_since_entry, transit
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    PlotStyle,
    raw_samples,
    rough_variance,
)
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean

# The expected time t2 is computed from t1, t3 and the numbers of parts. If the measured t2 differs
# from the expected t2 by at most this fraction of t3 - t1, the difference is attributed to jitter
# of an eye, and the expected t2 is used. A larger difference indicates a product of another length.
_SAME_RISE = 0.02
PARTS = 64  # number of parts from t1 to t3, which resolve 50 Hz on a slow belt

_parts = partial(parameter, minimum=0, maximum=1024)
_weights = partial(parameter, minimum=-1e6, maximum=1e6)


@dataclass(frozen=True)
class LearnedParameters(EstimatorParameters):
    """Parameters of the learned estimator: the parts of a pass, and weights that `tune` learns."""

    node: ClassVar[str] = 'identifier.learned'

    parts: int = _parts(
        0, 'number of equal parts from t2 to t3; 0: not trained, so the Hann-weighted mean is used'
    )
    rise_parts: int = _parts(0, 'number of equal parts from t1 to t2')
    lead_parts: int = _parts(
        0, 'number of equal parts before t1, each as long as the parts from t1 to t3 on average'
    )
    gap: float = parameter(
        0.0,
        'shortest time from the exit of the previous item to t1 with which the signal before t2 is '
        'used, as a multiple of t3 - t1',
        minimum=0,
        maximum=1e3,
    )
    weights: tuple[float, ...] = _weights(
        (0.0,), 'weights of the parts before t1, from t1 to t2 and from t2 to t3, for each speed'
    )
    weights_alone: tuple[float, ...] = _weights(
        (0.0,),
        'weights of the parts from t2 to t3 if only these are used, because the item follows too '
        'closely behind the previous one: `parts` values for each speed',
    )

    def fits(self, name: str, count: int) -> bool:
        """Return whether the list `name` may have `count` values."""
        own = {'weights': self.layout.count, 'weights_alone': self.parts}
        return count == len(self.speeds) * (own.get(name, 1) if self.parts else 1)

    @property
    def layout(self) -> 'Layout':
        """Numbers of parts of a pass."""
        return Layout(self.lead_parts, self.rise_parts, self.parts)


@dataclass(frozen=True, slots=True)
class Layout:
    """Numbers of parts before t1, from t1 to t2 and from t2 to t3."""

    lead: int
    rise: int
    window: int

    @property
    def count(self) -> int:
        """Number of all parts."""
        return self.lead + self.rise + self.window

    @property
    def lead_span(self) -> float:
        """Duration of the parts before t1 as a multiple of t3 - t1."""
        return self.lead / (self.rise + self.window)


class Learned(Estimator):
    """Weighted sum of the parts of a pass.

    Examples
    --------
    >>> print(round(Learned(LearnedParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = LearnedParameters()
    look = PlotStyle('Learned', '*', '#a3123a', '#ff6f91')

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the weighted sum of the parts as the load.

        The weights are interpolated between the training speeds. If the item follows too closely
        behind the previous one, only the parts from t2 to t3 are used, with ``weights_alone``.
        Without training, the load is the Hann-weighted mean. The variance is the result of
        `rough_variance`.
        """
        known, samples = self.parameters, raw_samples(window)
        if not known.parts:
            return LoadEstimate(float(hann_mean(samples)), rough_variance(samples))
        layout, table = known.layout, known.weights
        if not seconds_alone(window) >= max(known.gap, layout.lead_span) * transit(window):
            layout, table = Layout(0, 0, known.parts), known.weights_alone
        weights = _between(window.belt_speed, known.speeds, np.reshape(table, (-1, layout.count)))
        load = np.add.reduce(weights * pass_features(window, layout))
        return LoadEstimate(float(load), rough_variance(samples))


def _between(speed: float, speeds: tuple[float, ...], table: Array) -> Array:
    position = float(np.interp(speed, speeds, np.arange(len(speeds))))
    before = min(int(position), max(len(speeds) - 2, 0))
    after = min(before + 1, len(speeds) - 1)
    return np.asarray(table[before] + (position - before) * (table[after] - table[before]))


def rise_parts(share: float) -> int:
    """Return the number of parts before t2, 1 to ``PARTS - 1``, of the `PARTS` parts from t1 to t3.

    `share` is (t2 - t1) / (t3 - t1).
    """
    return min(max(round(PARTS * share), 1), PARTS - 1)


def seconds_alone(window: WeighWindow) -> float:
    """Return the time in s before t1 during which no other item was on the belt.

    The result is negative if the previous item left after t1.
    """
    return -float(time_since_entry(window, window.empty_begin, window.empty_begin + 1)[0])


def pass_features(window: WeighWindow, layout: Layout) -> Array:
    """Return the means of the signal in the parts of a pass in kg, (layout.count,).

    Each sample represents the interval around its time. All means are NaN if the first part begins
    before the signal, or if a part has no duration.
    """
    whole, rise = transit(window), rise_time(window)
    half = 0.5 / window.sample_rate
    time = time_since_entry(window, 0, window.window_end)
    ends = np.append(time - half, time[-1] + half)
    area = np.zeros(len(ends))
    np.cumsum(window.force_between(0, window.window_end), out=area[1:])
    total = layout.rise + layout.window
    turn = layout.rise / total * whole
    if not layout.rise or abs(rise - turn) > _SAME_RISE * whole:
        turn = rise
    before = np.arange(-layout.lead, 0) * (whole / total)
    rising = np.linspace(0.0, turn, layout.rise, endpoint=False)
    resting = np.linspace(turn, whole, layout.window + 1)
    # Limit the end of the last part, because the last sample may be up to one interval before t3.
    bounds = np.minimum(np.concatenate([before, rising, resting]), ends[-1])
    widths = np.diff(bounds)
    if not (bounds[0] >= ends[0] and np.all(widths > 0)):
        return np.full(layout.count, math.nan)
    return np.diff(np.interp(bounds, ends, area)) / widths / window.sample_rate
