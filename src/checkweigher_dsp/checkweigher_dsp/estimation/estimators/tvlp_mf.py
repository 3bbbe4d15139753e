# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""TVLP-MF estimator: the low-pass filters of TVLPF followed by a morphological filter.

This is a reconstruction from the title and the classification of the patent application
CN113225047A of Hunan University (Teng et al., 2021). The morphological filter is the mean of an
opening followed by a closing and of a closing followed by an opening, with a flat structuring
element (Maragos, Schafer, Morphological filters, IEEE Transactions on ASSP 35, 1987). The
morphological filter removes peaks and dips that are shorter than the structuring element. The load
is the mean of the last part of the filtered signal.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import ClassVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import Axis, PlotStyle
from checkweigher_dsp.estimation.estimators.tvlpf import Tvlpf, TvlpfParameters, lowpass_steps
from checkweigher_dsp.signal import Array

_share = partial(parameter, unit='share of the window', minimum=0, maximum=1)


@dataclass(frozen=True)
class TvlpMfParameters(TvlpfParameters):
    """Parameters of TVLPF, and in addition the structuring element and the averaged part."""

    node: ClassVar[str] = 'identifier.tvlp_mf'

    element: tuple[float, ...] = _share((0.1,), 'length of the structuring element')
    rest: tuple[float, ...] = _share((0.3,), 'part before t3 that is averaged')


class TvlpMf(Tvlpf):
    """Mean of the signal after low-pass filters and a morphological filter (reconstruction).

    Examples
    --------
    >>> print(round(TvlpMf(TvlpMfParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = TvlpMfParameters()
    look = PlotStyle('TVLP-MF', 'v', '#7d7400', '#c9bd3a')
    axes = (*Tvlpf.axes, Axis('element', 0.0, 0.6, 0.1), Axis('rest', 0.02, 1.0, 0.3))

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the mean in kg of the last part of the filtered signal."""
        known, speed, count = self.parameters, window.belt_speed, len(samples)
        smoothing = lowpass_matrix(count, *self.settings(window, count))
        element = 1 + 2 * round(known.at('element', speed) * count / 2)
        filtered = morphological(np.add.reduce(smoothing * samples, axis=-1), element)
        return float(np.mean(filtered[-max(1, round(known.at('rest', speed) * count)) :]))


@lru_cache(maxsize=16)
def lowpass_matrix(
    count: int, sections: int, initial_cutoff: float, final_cutoff: float, decay: float, rate: float
) -> Array:
    """Return the weight of each sample in each output of the filter of TVLPF, (count, count).

    Row n contains the weights of all samples in the output at sample n. See `lowpass_weights` for
    the parameters.
    """
    steps = lowpass_steps(count, initial_cutoff, final_cutoff, decay, rate)
    section = np.zeros((count, count))
    section[0, 0] = 1.0
    for row, step in enumerate(steps[1:], start=1):
        section[row] = (1 - step) * section[row - 1]
        section[row, row] = step
    smoothing: Array = np.linalg.matrix_power(section, sections)
    smoothing.flags.writeable = False
    return smoothing


def morphological(signal: Array, element: int) -> Array:
    """Return the mean of opening-closing and closing-opening of a signal, (n,).

    `element` is the odd length of the structuring element in samples.

    Examples
    --------
    >>> morphological(np.array([1.0, 1.0, 9.0, 1.0, 1.0, 1.0]), 3).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    opened_closed = _close(_open(signal, element), element)
    closed_opened = _open(_close(signal, element), element)
    return (opened_closed + closed_opened) / 2


def _open(signal: Array, element: int) -> Array:
    return -_erode(-_erode(signal, element), element)


def _close(signal: Array, element: int) -> Array:
    return -_open(-signal, element)


def _erode(signal: Array, element: int) -> Array:
    """Return, for each sample of a signal, (n,), the minimum under the element centred on it."""
    padded = np.pad(signal, element // 2, 'edge')
    return np.asarray(sliding_window_view(padded, element).min(axis=-1))
