"""Denoising of a weigh window: shrinkage on a stretch that goes far beyond it to both sides."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising.entry_fit import EntryFit
from checkweigher_dsp.denoising.extrapolation import extend
from checkweigher_dsp.denoising.load_rise import load_response, load_share
from checkweigher_dsp.denoising.shrinkage_table import UNTRAINED, ShrinkageTable, column
from checkweigher_dsp.denoising.wavelet_shrinkage import (
    LEVELS,
    ShrinkageFilter,
    threshold_universally,
)
from checkweigher_dsp.denoising.window_batch import (
    PassStack,
    lone_pass,
    rise_time,
    stack_passes,
    stretch_length,
    time_since_entry,
)
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import WeighWindow
from checkweigher_dsp.signal.averages import hann_mean

_PERIOD = 2**LEVELS

# What a window can be surrounded with, see `Denoiser` and `surround`.
SURROUNDS = ('continuation', 'level', 'mirror', 'signal')
METHODS = ('shrinkage', 'soft', 'hard')


@dataclass(frozen=True)
class DenoiseParameters(Parameters):
    """The shrinkage table of the machine and what stands around a window."""

    node: ClassVar[str] = 'denoise'

    method: str = parameter(
        'shrinkage', 'shrinkage by the table, or soft or hard universal threshold', choices=METHODS
    )
    each_level: bool = parameter(
        False, 'noise of soft and hard from each level itself, not from the finest one'
    )
    speeds: tuple[float, ...] = parameter(
        UNTRAINED.speeds, 'belt speeds of the table, ascending', unit='m/s', minimum=1e-3,
        maximum=100,
    )  # fmt: skip
    gamma5: tuple[float, ...] = parameter(
        UNTRAINED.gains[0], 'gain of band 5 at each speed', minimum=0, maximum=10
    )
    gamma6: tuple[float, ...] = parameter(
        UNTRAINED.gains[1], 'gain of band 6 at each speed', minimum=0, maximum=10
    )
    gamma7: tuple[float, ...] = parameter(
        UNTRAINED.gains[2], 'gain of band 7 at each speed', minimum=0, maximum=10
    )
    lambda5: tuple[float, ...] = parameter(
        UNTRAINED.thresholds[0], 'threshold of band 5 at each speed', unit='threshold_unit',
        minimum=0,
    )  # fmt: skip
    lambda6: tuple[float, ...] = parameter(
        UNTRAINED.thresholds[1], 'threshold of band 6 at each speed', unit='threshold_unit',
        minimum=0,
    )  # fmt: skip
    lambda7: tuple[float, ...] = parameter(
        UNTRAINED.thresholds[2], 'threshold of band 7 at each speed', unit='threshold_unit',
        minimum=0,
    )  # fmt: skip
    threshold_unit: float = parameter(
        1e-7, 'what one unit of the thresholds is on this load cell', unit='kg',
        minimum=0, maximum=1e3,
    )  # fmt: skip
    surround: str = parameter(
        'continuation', 'what stands around the window in the stretch', choices=SURROUNDS
    )
    stretch: int = parameter(
        1024, 'length of the stretch that is denoised, at least', unit='samples',
        minimum=_PERIOD, maximum=2**20,
    )  # fmt: skip
    natural_frequency: tuple[float, ...] = parameter(
        (38.0,), 'of the empty platform, for continuation: one value or one at each speed',
        unit='Hz', minimum=0.1, maximum=1e4,
    )  # fmt: skip
    damping_ratio: tuple[float, ...] = parameter(
        (0.06,), 'of the empty platform, for continuation: one value or one at each speed',
        minimum=0, maximum=0.99,
    )  # fmt: skip
    moving_mass: float = parameter(
        2.5, 'of the empty platform, for continuation: what a product is added to', unit='kg',
        minimum=1e-3, maximum=1e4,
    )  # fmt: skip
    prediction_order: int = parameter(
        40, 'order of the model that continues the disturbance', minimum=0, maximum=1000
    )
    iterations: int = parameter(
        1, 'how often the level that is taken out for continuation is found anew', minimum=0,
        maximum=100,
    )  # fmt: skip
    edge_uncertainty: float = parameter(
        0.0, 'by which t1 and t2 may be off, for continuation; 0: they are exact', unit='s',
        minimum=0, maximum=0.1,
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
        for name in ('natural_frequency', 'damping_ratio'):
            if len(getattr(self, name)) not in (1, len(self.speeds)):
                raise ParameterError(
                    f'denoise.{name}: {len(getattr(self, name))} values, must be 1 or '
                    f'{len(self.speeds)}, one for each of speeds'
                )

    @cached_property
    def table(self) -> ShrinkageTable:
        """The shrinkage table; ValueError if its columns do not fit together."""
        return ShrinkageTable(
            self.speeds,
            (self.gamma5, self.gamma6, self.gamma7),
            (self.lambda5, self.lambda6, self.lambda7),
        )

    def platform(self, speed: Any) -> list[Any]:
        """Return natural frequency and damping ratio of the empty platform.

        Parameters
        ----------
        speed : float or ndarray, (passes,)
            m/s; an array makes (passes, 1) of what goes with the speed.
        """
        return [
            column(self.speeds, values, speed) if len(values) > 1 else values[0]
            for values in (self.natural_frequency, self.damping_ratio)
        ]


class Denoiser:
    """Denoise weigh windows with the shrinkage of their belt speed.

    The wavelet of level 7 is far longer than any window, so what stands around the window decides
    the result: docs/method.md compares the ways to do it; the paper leaves it open. With
    ``continuation``, an own derivation, the level of the window as the platform shows it from t1
    on is taken out of the signal, so that the disturbance alone is left: before t1, while the load
    rises, and in the window. It is continued to both sides by linear prediction, put on the level
    and denoised. A level that is wrong leaves a step, so the level is then found anew in what has
    been denoised; so are t1 and t2 in the signal if they are uncertain. In the end the rise is put
    back as the bare share of the product on the belt, by t1 and t2 as the photo-eyes say.
    """

    def __init__(self, parameters: DenoiseParameters) -> None:
        self._parameters = parameters

    def denoise(self, window: WeighWindow) -> WeighWindow:
        """Return the window with `denoised` filled in; a fault passes unchanged.

        Filled in is t1..t3 with ``continuation``, t2..t3 with the other ways; elsewhere is NaN.
        """
        if window.reasons:
            return window
        if not is_consistent(window):
            return replace(window, reasons=(Reason.BAD_WINDOW.value,))
        parameters = self._parameters
        if parameters.edge_uncertainty:  # which is fitted in stacks alone
            (stack,) = stack_passes([window], parameters.stretch)
            return _with_denoised(window, denoise_stack(stack, parameters)[0])
        alone = lone_pass(window, parameters.stretch)
        return _with_denoised(window, denoise_stack(alone, parameters))

    def denoise_all(self, windows: Sequence[WeighWindow]) -> list[WeighWindow]:
        """Return what `denoise` makes of each window, to the last bit, in much less time.

        Windows of equal shape are denoised at once.
        """
        result = list(windows)
        usable = []
        for number, window in enumerate(windows):
            if is_consistent(window) and not window.reasons:
                usable.append(number)
            else:
                result[number] = self.denoise(window)
        for begin in range(0, len(usable), _AT_ONCE):
            numbers = usable[begin : begin + _AT_ONCE]
            chosen = [windows[number] for number in numbers]
            stretch = self._parameters.stretch
            for stack in stack_passes(chosen, stretch, same_entry=True, most=_MOST_PASSES):
                rows = denoise_stack(stack, self._parameters)
                for position, row in zip(stack.positions, rows, strict=True):
                    result[numbers[position]] = _with_denoised(chosen[position], row)
        return result


# Windows that `Denoiser.denoise_all` sorts into stacks: a few MB, and no slower than more of them.
_AT_ONCE = 512
# Of one stack: what is larger gets its memory anew from the system at each step.
_MOST_PASSES = 100


def _with_denoised(window: WeighWindow, row: NDArray[np.float64]) -> WeighWindow:
    denoised = np.full(len(window.counts), math.nan)
    denoised[window.window_end - len(row) : window.window_end] = row
    return replace(window, denoised=denoised)


def denoise_stack(stack: PassStack, parameters: DenoiseParameters) -> NDArray[np.float64]:
    """Denoise passes of equal shape.

    Returns
    -------
    ndarray, (passes, n) float64
        kg, at the same columns as ``stack.force``; NaN before t1 or t2, see `Denoiser`.
    """
    force, begin = stack.force, stack.begin
    result = np.full(force.shape, math.nan)
    if parameters.surround == 'continuation':
        result[..., stack.entry :] = _denoise_continued(stack, parameters)[..., stack.entry :]
        return result
    stretch, offset = surround(
        force[..., begin:], parameters.stretch, parameters.surround, force[..., :begin]
    )
    count = force.shape[-1] - begin
    measured = slice(offset, offset + count)
    remove_noise, _ = _noise_remover(stretch.shape[-1], measured, stack, parameters)
    result[..., begin:] = remove_noise(stretch)[..., measured]
    return result


def _denoise_continued(stack: PassStack, parameters: DenoiseParameters) -> NDArray[np.float64]:
    """Denoise passes on their continued disturbance."""
    force, begin = stack.force, stack.begin
    count = force.shape[-1] - begin
    length = stretch_length(parameters.stretch, count)
    before = (length - count) // 2 - begin
    measured = slice(before, before + force.shape[-1])
    remove_noise, mean_of = _noise_remover(length, measured, stack, parameters)
    natural_frequency, damping_ratio = parameters.platform(stack.belt_speed)
    first, time, rise_time = stack.entry, stack.time[..., stack.entry :], stack.rise_time
    entry, model = None, None
    response = np.zeros(force.shape)
    level = _over_passes(np.add.reduce(force[..., begin:], axis=-1) / count)
    iteration = 0
    while True:
        # Both fall with the square root of the moving mass.
        moving = parameters.moving_mass
        ease = np.sqrt(moving / (moving + np.maximum(level, 0.0)))
        platform = natural_frequency * ease, damping_ratio * ease
        if parameters.edge_uncertainty:
            entry = entry or EntryFit(stack, parameters.edge_uncertainty, level, *platform)
            first, time, rise_time = entry.times(model)
        response[..., first:] = load_response(time, rise_time, *platform)
        stretch, model = extend(
            force - level * response, before, length - measured.stop, parameters.prediction_order,
            stack.block,
        )  # fmt: skip
        stretch += level
        if iteration == parameters.iterations:
            return remove_noise(stretch)[..., measured] - level * (1 - stack.share)
        level = _over_passes(mean_of(stretch, slice(before + begin, measured.stop)))
        iteration += 1


def _over_passes(values: Any) -> Any:
    """Return values of the passes of a stack (passes,) as a column, and a lone one as a float."""
    return values[:, None] if np.ndim(values) else float(values)


def _noise_remover(
    length: int, measured: slice, stack: PassStack, parameters: DenoiseParameters
) -> tuple[Callable[[NDArray[np.float64]], NDArray[np.float64]], Callable[..., Any]]:
    """Return how to denoise the stretches of a stack, and how to find means of what that makes."""
    if parameters.method == 'shrinkage':
        details = parameters.table.at(stack.belt_speed, parameters.threshold_unit)
        shrinkage = ShrinkageFilter(length, details)
        remove_noise = shrinkage.apply
        if parameters.table.is_linear:
            return remove_noise, shrinkage.mean
    else:
        remove_noise = partial(
            threshold_universally,
            hard=parameters.method == 'hard',
            measured=measured,
            each_level=parameters.each_level,
        )
    return remove_noise, lambda stretch, part: np.mean(remove_noise(stretch)[..., part], axis=-1)


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
    samples : ndarray, (..., n) float64
        The window.
    min_length : int
        The stretch is the next multiple of 128 from this and from ``2 n``.
    method : str
        ``level``: both sides are the Hann-weighted mean of the window. ``mirror``: the window is
        reflected at its ends, again and again. ``signal``: the signal itself before the window
        and its level after it.
    before : ndarray, (..., k) float64
        Signal before the window, for ``signal``; where it is too short it begins at its level.

    Returns
    -------
    stretch : ndarray, (..., m) float64
        The window in the middle of what surrounds it.
    offset : int
        Position of the window in it.
    """
    count = samples.shape[-1]
    length = stretch_length(min_length, count)
    offset = (length - count) // 2
    if method == 'mirror':
        sides = [(0, 0)] * (samples.ndim - 1) + [(offset, length - count - offset)]
        return np.pad(samples, sides, 'symmetric'), offset
    stretch = np.empty((*samples.shape[:-1], length))
    stretch[...] = np.asarray(hann_mean(samples))[..., None]
    if method == 'signal' and before is not None and before.shape[-1]:
        known = before[..., -offset:]
        stretch[..., :offset] = known[..., :1]
        stretch[..., offset - known.shape[-1] : offset] = known
    stretch[..., offset : offset + count] = samples
    return stretch, offset


def denoised_pass(window: WeighWindow) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what has been denoised of a window and the load that was on the belt.

    Returns
    -------
    denoised : ndarray, (n,) float64
        kg, from t1 or t2 on up to t3.
    share : ndarray, (n,) float64
        Share of the product on the belt at each of these samples, 1 from t2 on.
    """
    begin, end = window.window_begin, window.window_end
    missing = int(np.count_nonzero(np.isnan(window.denoised[:begin])))
    share = np.ones(end - missing)
    share[: begin - missing] = load_share(
        time_since_entry(window, missing, begin), rise_time(window)
    )
    return window.denoised[missing:end], share


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
