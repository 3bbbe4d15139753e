"""Denoising of a weigh window: shrinkage on a stretch that is made from the window alone."""

from dataclasses import dataclass, replace
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.averaging import hann_mean
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import Reason, WeighWindow
from checkweigher_dsp.shrinkage_table import TABLE_1, ShrinkageTable
from checkweigher_dsp.wavelet_shrinkage import LEVELS, denoise_periodic

_PERIOD = 2**LEVELS

# What a window can be surrounded with, see `surround`.
SURROUNDS = ('level', 'mirror', 'signal')


@dataclass(frozen=True)
class DenoiseParameters(Parameters):
    """The shrinkage table of the machine; the default is Table 1 of the paper."""

    node: ClassVar[str] = 'denoise'

    speeds: tuple[float, ...] = parameter(
        TABLE_1.speeds, 'belt speeds of the table, ascending', unit='m/s', minimum=1e-3, maximum=100
    )
    gamma5: tuple[float, ...] = parameter(
        TABLE_1.gains[0], 'gain of band 5 at each speed', minimum=0, maximum=10
    )
    gamma6: tuple[float, ...] = parameter(
        TABLE_1.gains[1], 'gain of band 6 at each speed', minimum=0, maximum=10
    )
    gamma7: tuple[float, ...] = parameter(
        TABLE_1.gains[2], 'gain of band 7 at each speed', minimum=0, maximum=10
    )
    lambda5: tuple[float, ...] = parameter(
        TABLE_1.thresholds[0], 'threshold of band 5 at each speed', unit='threshold_unit', minimum=0
    )
    lambda6: tuple[float, ...] = parameter(
        TABLE_1.thresholds[1], 'threshold of band 6 at each speed', unit='threshold_unit', minimum=0
    )
    lambda7: tuple[float, ...] = parameter(
        TABLE_1.thresholds[2], 'threshold of band 7 at each speed', unit='threshold_unit', minimum=0
    )
    threshold_unit: float = parameter(
        1e-7, 'what one unit of the thresholds is on this load cell', unit='kg',
        minimum=0, maximum=1e3,
    )  # fmt: skip
    surround: str = parameter(
        'level', 'what stands around the window in the stretch', choices=SURROUNDS
    )
    stretch: int = parameter(
        1024, 'length of the stretch that is denoised, at least', unit='samples',
        minimum=_PERIOD, maximum=2**20,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('lambda5', 'lambda6', 'lambda7'):
            if not all(math.isfinite(value) for value in getattr(self, name)):
                raise ParameterError(f'denoise.{name}: thresholds must be finite')
        try:
            _ = self.table
        except ValueError as error:
            raise ParameterError(f'denoise.speeds: {error}') from None

    @property
    def table(self) -> ShrinkageTable:
        """The shrinkage table; ValueError if its columns do not fit together."""
        return ShrinkageTable(
            self.speeds,
            (self.gamma5, self.gamma6, self.gamma7),
            (self.lambda5, self.lambda6, self.lambda7),
        )


class Denoiser:
    """Denoise weigh windows with the shrinkage of their belt speed.

    The wavelet of level 7 is far longer than any window, so what stands around the window decides
    the result: docs/method.md compares the ways to `surround` it.
    """

    def __init__(self, parameters: DenoiseParameters) -> None:
        self._parameters = parameters
        self._table = parameters.table

    def denoise(self, window: WeighWindow) -> WeighWindow:
        """Return the window with `denoised` filled in, NaN before t2; a fault passes unchanged."""
        if window.reasons:
            return window
        if not is_consistent(window):
            return replace(window, reasons=(Reason.BAD_WINDOW.value,))
        begin, end = window.window_begin, window.window_end
        denoised = np.full(len(window.counts), math.nan)
        details = self._table.at(window.belt_speed, self._parameters.threshold_unit)
        force = window.force
        stretch, offset = surround(
            force[begin:end], self._parameters.stretch, self._parameters.surround, force[:begin]
        )
        result = denoise_periodic(stretch, details)
        denoised[begin:end] = result[offset : offset + end - begin]
        return replace(window, denoised=denoised)


def surround(
    samples: NDArray[np.float64],
    min_length: int,
    method: str = 'level',
    before: NDArray[np.float64] | None = None,
) -> tuple[NDArray[np.float64], int]:
    """Fill both sides of a window, up to a length that the transform can take.

    At t3 nothing later has been measured, so that what follows the window is made up in any case.

    Parameters
    ----------
    samples : ndarray, (n,) float64
        The window.
    min_length : int
        The stretch is the next multiple of 128 from this and from ``2 n``.
    method : str
        ``level``: both sides are the Hann-weighted mean of the window. ``mirror``: the window is
        reflected at its ends, again and again. ``signal``: the signal itself before the window
        and its level after it.
    before : ndarray, (k,) float64
        Signal before the window, for ``signal``; where it is too short it begins at its level.

    Returns
    -------
    stretch : ndarray, (m,) float64
        The window in the middle of what surrounds it.
    offset : int
        Position of the window in it.
    """
    count = len(samples)
    length = _PERIOD * math.ceil(max(min_length, 2 * count) / _PERIOD)
    offset = (length - count) // 2
    if method == 'mirror':
        return np.pad(samples, (offset, length - count - offset), 'symmetric'), offset
    stretch = np.full(length, hann_mean(samples))
    if method == 'signal' and before is not None and len(before):
        known = before[-offset:]
        stretch[:offset] = known[0]
        stretch[offset - len(known) : offset] = known
    stretch[offset : offset + count] = samples
    return stretch, offset


def is_consistent(window: WeighWindow) -> bool:
    """Tell whether the fields of a window that claims to be whole fit together."""
    return (
        0 <= window.window_begin < window.window_end <= len(window.counts)
        and all(
            math.isfinite(value) and value > 0 for value in (window.sample_rate, window.belt_speed)
        )
        and math.isfinite(window.zero)
        and math.isfinite(window.zero_counts)
        and math.isfinite(window.zero_std_dev)
        and math.isfinite(window.counts_per_kg)
        and window.counts_per_kg != 0
    )
