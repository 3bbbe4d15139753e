# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""TVLPF estimator: a cascade of low-pass filters whose cut-off falls during the window.

This is a reconstruction from the abstracts of two papers: Pietrzak, Meller, Niedzwiecki, Dynamic
mass measurement in checkweighers using a discrete time-variant low-pass filter, Mechanical Systems
and Signal Processing 48 (2014), and the conference version of 2010. A filter with a high cut-off
follows the load quickly, and a filter with a low cut-off suppresses vibration. So the cut-off falls
during the window:

.. math:: f(n) = f_\infty + (f_0 - f_\infty) r^n .

f(n) is the cut-off frequency at sample n after t2. The cut-off falls from f_0 towards f_inf, and r
is the factor by which its distance from f_inf is multiplied at each sample.
"""

from dataclasses import dataclass
from functools import lru_cache
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


@dataclass(frozen=True)
class TvlpfParameters(EstimatorParameters):
    """Parameters of TVLPF: number of sections, and cut-off as a function of time in the window."""

    node: ClassVar[str] = 'identifier.tvlpf'

    sections: tuple[float, ...] = parameter(
        (2.0,), 'number of first-order sections, rounded', minimum=1, maximum=8
    )
    initial_cutoff: tuple[float, ...] = parameter(
        (50.0,), 'cut-off frequency at t2', unit='Hz', minimum=0, maximum=1e5
    )
    final_cutoff: tuple[float, ...] = parameter(
        (3.0,), 'limit of the cut-off frequency after t2', unit='Hz', minimum=0, maximum=1e5
    )
    half_life: tuple[float, ...] = parameter(
        (0.1,),
        'time in which the distance from the final cut-off frequency halves, as a fraction of the '
        'window',
        minimum=1e-4,
        maximum=1e3,
    )


class Tvlpf(Average):
    """Last output of a low-pass filter whose cut-off falls (reconstruction).

    Examples
    --------
    >>> print(round(Tvlpf(TvlpfParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = TvlpfParameters()
    look = PlotStyle('TVLPF', '^', '#c98500', '#e8ac2f')
    axes: ClassVar[tuple[Axis, ...]] = (
        Axis('sections', 2, 4, 2, whole=True),
        Axis('initial_cutoff', 2.0, 400.0, 50.0, logarithmic=True),
        Axis('final_cutoff', 0.1, 30.0, 3.0, logarithmic=True),
        Axis('half_life', 0.02, 2.0, 0.1, logarithmic=True),
    )

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the output of the filter at the last sample before t3."""
        count = len(samples)
        weights = lowpass_weights(count, *self.settings(window, count))
        return float(np.add.reduce(samples * weights))

    def settings(self, window: WeighWindow, count: int) -> tuple[int, float, float, float, float]:
        """Return all arguments of `lowpass_weights` except `count`, the number of samples."""
        known, speed = self.parameters, window.belt_speed
        return (
            max(1, round(known.at('sections', speed))),
            known.at('initial_cutoff', speed),
            known.at('final_cutoff', speed),
            0.5 ** (1 / (known.at('half_life', speed) * count)),
            window.sample_rate,
        )


def lowpass_steps(
    count: int, initial_cutoff: float, final_cutoff: float, decay: float, sample_rate: float
) -> Array:
    """Return alpha(n), the weight of sample n in the output of a section at this sample, (count,).

    See `lowpass_weights` for the formula of alpha(n) and for the parameters.
    """
    cutoff = final_cutoff + (initial_cutoff - final_cutoff) * decay ** np.arange(count)
    steps: Array = -np.expm1(-2 * math.pi / sample_rate * cutoff)
    return steps


@lru_cache(maxsize=256)
def lowpass_weights(
    count: int,
    sections: int,
    initial_cutoff: float,
    final_cutoff: float,
    decay: float,
    sample_rate: float,
) -> Array:
    r"""Return the weight of each sample in the last output of the filter.

    Each section is :math:`y(n) = y(n-1) + \alpha(n) (x(n) - y(n-1))` with
    :math:`\alpha(n) = 1 - e^{-2 \pi f(n) / f_s}`. A section has the pole of an analogue first-order
    low-pass filter, and unity gain at any cut-off. The initial value of all sections is the first
    sample. With the initial value 0, the output would only approach a constant load, and would be
    biased.

    The filter is linear, so the last output is a weighted mean of the samples. The weights are
    computed by the transposed cascade, which runs backwards in time.

    Parameters
    ----------
    count : int
        Number of samples of the window, at least 1.
    sections : int
        Number of first-order sections, at least 1.
    initial_cutoff, final_cutoff : float
        Cut-off frequencies f_0 and f_inf in Hz, not negative.
    decay : float
        Ratio r by which the distance of the cut-off from f_inf is multiplied at each sample, 0 to
        1.
    sample_rate : float
        Sample rate in Hz.

    Returns
    -------
    ndarray, (count,) float64
        Read-only weights, which are not negative and have the sum 1.

    Examples
    --------
    >>> weights = lowpass_weights(192, 2, 50.0, 3.0, 0.98, 960.0)
    >>> ringing = 1 + 0.5 * np.cos(np.arange(192.0))
    >>> print((weights @ ringing).round(2))
    1.0
    """
    steps = lowpass_steps(count, initial_cutoff, final_cutoff, decay, sample_rate).tolist()
    weights = np.zeros(count)
    # adjoint[j] is the weight of the state of section j in the last output.
    adjoint = [0.0] * (sections - 1) + [1.0]
    for index in range(count - 1, -1, -1):
        step = steps[index]
        for section in range(sections - 1, 0, -1):
            adjoint[section - 1] += step * adjoint[section]
            adjoint[section] *= 1 - step
        weights[index] = step * adjoint[0]
        adjoint[0] *= 1 - step
    weights[0] += sum(adjoint)
    weights.flags.writeable = False
    return weights
