# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""LMS notch estimator: an adaptive notch filter, a moving average, and a trimmed mean.

This is a reconstruction from the abstract of a paper on checkweighers in the Chinese Journal of
Scientific Instrument 40 (7), 2019: a notch filter adapted by least mean squares (LMS) with a
variable step (versiera), a moving average, and an asymmetrically trimmed mean. The filter removes
one frequency (Widrow et al., Adaptive noise cancelling, Proceedings of the IEEE 63 (1975)
1692-1716) from the relative deviation d of the signal from its mean. The vector x contains the
cosine and the sine at the removed frequency, w contains their amplitudes in d, and e is the output
of the filter:

.. math:: e = d - w' x,\quad w \leftarrow w + 2 \mu e x,\quad \mu = \beta - \beta / (1 + \alpha e^2)

The step size mu is 0 for e = 0, and approaches beta for a large e. A larger alpha makes the step
size increase faster with the magnitude of e.
"""

from dataclasses import dataclass
from functools import partial
import math
from typing import ClassVar

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import (
    Average,
    Axis,
    EstimatorParameters,
    PlotStyle,
)
from checkweigher_dsp.signal import Array

_share = partial(parameter, minimum=0, maximum=0.45)


@dataclass(frozen=True)
class LmsNotchParameters(EstimatorParameters):
    """Parameters of the LMS notch: frequency, step, moving average, and trimmed shares."""

    node: ClassVar[str] = 'identifier.lms_notch'

    frequency: tuple[float, ...] = parameter(
        (38.0,), 'frequency of the notch', unit='Hz', minimum=0, maximum=1e5
    )
    step: tuple[float, ...] = parameter(
        (0.05,), 'largest step size beta of the LMS algorithm', minimum=0, maximum=0.5
    )
    sharpness: tuple[float, ...] = parameter(
        (1e3,),
        'parameter alpha of the step size: the larger it is, the faster the step size increases '
        'with the error',
        minimum=0,
        maximum=1e12,
    )
    smoothing: tuple[float, ...] = parameter(
        (0.3,), 'length of the moving average, as a share of the window', minimum=0, maximum=1
    )
    cut_low: tuple[float, ...] = _share(
        (0.1,), 'fraction of the moving averages that is not used, of the smallest ones'
    )
    cut_high: tuple[float, ...] = _share(
        (0.1,), 'fraction of the moving averages that is not used, of the largest ones'
    )


class LmsNotch(Average):
    """Trimmed mean of the signal from which one oscillation is removed (reconstruction).

    Examples
    --------
    >>> print(round(LmsNotch(LmsNotchParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = LmsNotchParameters()
    look = PlotStyle('LMS notch', 'X', '#1f6f8b', '#6cc3dd')
    axes = (
        Axis('frequency', 4.0, 120.0, 38.0, logarithmic=True),
        Axis('step', 1e-3, 0.5, 0.05, logarithmic=True),
        Axis('sharpness', 1.0, 1e8, 1e3, logarithmic=True),
        Axis('smoothing', 0.0, 1.0, 0.3),
        Axis('cut_low', 0.0, 0.45, 0.1),
        Axis('cut_high', 0.0, 0.45, 0.1),
    )

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the trimmed mean of the moving averages of the filtered signal in kg.

        The result is NaN if the mean of the samples is 0.
        """
        level, count = float(np.mean(samples)), len(samples)
        if level == 0:
            return math.nan
        frequency, step, sharpness, smoothing, cut_low, cut_high = (
            self.parameters.at(axis.name, window.belt_speed) for axis in self.axes
        )
        angle = 2 * math.pi * frequency / window.sample_rate
        left = notch(samples / level - 1.0, angle, step, sharpness)
        size = max(1, round(smoothing * count))
        sums = np.append(0.0, np.cumsum(left))
        means = np.sort(sums[size:] - sums[:-size]) / size
        kept = means[int(cut_low * len(means)) : len(means) - int(cut_high * len(means))]
        return level * (1.0 + float(np.mean(kept)))


def notch(signal: Array, angle: float, step: float, sharpness: float) -> Array:
    """Return a signal, (n,), without the oscillation that advances by `angle` rad per sample.

    The filter adapts to the oscillation, so it does not remove the first periods completely. `step`
    is the largest step size, beta, and `sharpness` is alpha in the equation of the module.
    """
    phase, first, second = angle * np.arange(len(signal)), 0.0, 0.0
    left = []
    for value, cosine, sine in zip(
        signal.tolist(), np.cos(phase).tolist(), np.sin(phase).tolist(), strict=True
    ):
        error = value - first * cosine - second * sine
        change = 2 * step * (1.0 - 1.0 / (1.0 + sharpness * error * error)) * error
        first, second = first + change * cosine, second + change * sine
        left.append(error)
    return np.array(left)
