# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Denoising of weigh windows by wavelet shrinkage after padding."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
import math
from typing import Any, ClassVar

import numpy as np

from checkweigher_core.parameters import ParameterError, Parameters, check_cost, parameter
from checkweigher_core.records import WeighWindow
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.denoising.entry_fit import EntryFit
from checkweigher_dsp.denoising.extrapolation import extrapolate
from checkweigher_dsp.denoising.load_rise import load_response
from checkweigher_dsp.denoising.shrinkage_table import UNTRAINED, ShrinkageTable
from checkweigher_dsp.denoising.wavelet_shrinkage import (
    LEVELS,
    denoise_periodic,
    threshold_universally,
)
from checkweigher_dsp.denoising.window_batch import (
    WindowBatch,
    batches_of,
    is_consistent,
    padded_length,
)
from checkweigher_dsp.items.failures import PRINTED, Failures
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean

_gain = partial(parameter, minimum=0, maximum=10)
_threshold = partial(parameter, unit='threshold_unit', minimum=0)

PADDINGS = ('continuation', 'level', 'mirror', 'signal')  # see `Denoiser` and `pad`
METHODS = ('shrinkage', 'soft', 'hard')


@dataclass(frozen=True)
class DenoiseParameters(Parameters):
    """Parameters of the denoiser: the method, the shrinkage table of the machine, and the padding.

    Raises
    ------
    ParameterError
        If a value is not allowed, the lists do not match the speeds, or the computation for one
        item would take too long.
    """

    node: ClassVar[str] = 'denoise'

    method: str = parameter(
        'shrinkage',
        'shrinkage by the table, or soft or hard thresholding by the universal threshold',
        choices=METHODS,
    )
    each_level: bool = parameter(
        False,
        'whether soft and hard thresholding estimate the noise in each level; false: only in the '
        'finest level',
    )
    speeds: tuple[float, ...] = parameter(
        UNTRAINED.speeds,
        'belt speeds of the table, ascending',
        unit='m/s',
        minimum=1e-3,
        maximum=100,
    )
    gamma5: tuple[float, ...] = _gain(UNTRAINED.gains[0], 'gain of band 5 at each speed')
    gamma6: tuple[float, ...] = _gain(UNTRAINED.gains[1], 'gain of band 6 at each speed')
    gamma7: tuple[float, ...] = _gain(UNTRAINED.gains[2], 'gain of band 7 at each speed')
    lambda5: tuple[float, ...] = _threshold(
        UNTRAINED.thresholds[0], 'threshold of band 5 at each speed'
    )
    lambda6: tuple[float, ...] = _threshold(
        UNTRAINED.thresholds[1], 'threshold of band 6 at each speed'
    )
    lambda7: tuple[float, ...] = _threshold(
        UNTRAINED.thresholds[2], 'threshold of band 7 at each speed'
    )
    threshold_unit: float = parameter(
        1e-7, 'unit of the thresholds in the table', unit='kg', minimum=0, maximum=1e3
    )
    surround: str = parameter(
        'continuation',
        'kind of padding that extends each window on both sides to the length stretch',
        choices=PADDINGS,
    )
    stretch: int = parameter(
        1024,
        'shortest length of the padded signal that is denoised',
        unit='samples',
        minimum=2**LEVELS,
        maximum=2**20,
    )
    natural_frequency: tuple[float, ...] = parameter(
        (38.0,),
        'natural frequency of the empty platform, for the padding continuation; one value, or one '
        'per speed',
        unit='Hz',
        minimum=0.1,
        maximum=1e4,
    )
    damping_ratio: tuple[float, ...] = parameter(
        (0.06,),
        'damping ratio of the empty platform, for the padding continuation; one value, or one per '
        'speed',
        minimum=0,
        maximum=0.99,
    )
    moving_mass: float = parameter(
        2.5,
        'moving mass of the empty platform without the product, for the padding continuation',
        unit='kg',
        minimum=1e-3,
        maximum=1e4,
    )
    prediction_order: int = parameter(
        40,
        'order of the linear prediction of the disturbance, for the padding continuation',
        minimum=0,
        maximum=1000,
    )
    iterations: int = parameter(
        1,
        'number of times that the load is estimated again, for the padding continuation',
        minimum=0,
        maximum=100,
    )
    edge_uncertainty: float = parameter(
        0.0,
        'largest error of t1 and t2, for the padding continuation; 0: the times are exact',
        unit='s',
        minimum=0,
        maximum=0.1,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('lambda5', 'lambda6', 'lambda7'):
            if not np.all(np.isfinite(getattr(self, name))):
                raise ParameterError(f'denoise.{name}: thresholds must be finite')
        try:
            _ = self.table
        except ValueError as error:
            raise ParameterError(f'denoise.speeds: {error}') from None
        for name in ('natural_frequency', 'damping_ratio'):
            count = len(getattr(self, name))
            if count not in (1, len(self.speeds)):
                raise ParameterError(
                    f'denoise.{name}: {count} values, but 1 or {len(self.speeds)} (one per speed) '
                    'are needed'
                )
        check_cost(self, _cost, 'stretch', 'prediction_order', 'iterations')

    @cached_property
    def table(self) -> ShrinkageTable:
        """Shrinkage table. Raises `ValueError` if the speeds or the list lengths are not valid."""
        return ShrinkageTable(
            self.speeds,
            (self.gamma5, self.gamma6, self.gamma7),
            (self.lambda5, self.lambda6, self.lambda7),
        )

    def platform(self, speed: Array) -> tuple[Any, ...]:
        """Return the natural frequency in Hz and the damping ratio of the empty platform.

        `speed`, (windows, 1), contains belt speeds in m/s. A parameter with one value per speed is
        interpolated linearly between the speeds and constant beyond them, and the result has the
        shape of `speed`. A parameter with a single value is returned as a float.
        """
        return tuple(
            np.interp(speed, self.speeds, values) if len(values) > 1 else values[0]
            for values in (self.natural_frequency, self.damping_ratio)
        )


def _cost(stretch: int, prediction_order: int, iterations: int) -> float:
    """Return the longest computing time in s of a window with at most `stretch` / 2 samples.

    The coefficients of the formula were measured on one core of a computer of 2024, with blocks of
    one sample for the extrapolation.
    """
    return (iterations + 1) * (2e-4 + 3e-7 * stretch + 1e-5 * prediction_order)


class Denoiser:
    """Stage that denoises weigh windows by the wavelet shrinkage for their belt speed.

    The wavelet of level 7 has about 3900 samples, many more than most windows. So the result
    depends mainly on the padding around the window, which the original paper (see docs/method.md)
    does not specify. docs/method.md compares several kinds of padding.

    The padding ``continuation`` was derived in this project. The response of the platform to the
    load is subtracted from the signal. The remaining disturbance is extrapolated to both sides by
    linear prediction, the load is added as a constant, and the result is denoised. A wrong load
    would leave a step in the disturbance, so the load is estimated again from the denoised signal.
    If ``edge_uncertainty`` is above 0, t1 and t2 are corrected by a fit to the signal before the
    response is subtracted. Finally, the constant load before t2 is replaced by a load that rises
    linearly from 0 at t1. This rise has t1 and t2 as measured by the photo-eyes.

    If a window causes an exception, `failures` reports it, and the window gets the reason
    StageFailed.
    """

    def __init__(self, parameters: DenoiseParameters, failures: Failures = PRINTED) -> None:
        self._parameters = parameters
        self._failures = failures

    def denoise(self, window: WeighWindow) -> WeighWindow:
        """Return a window with its `denoised` signal in kg.

        The denoised signal ends at t3. With the padding ``continuation``, the denoised signal
        begins at t1. The signal begins after t1 if the previous item was still on the belt at t1,
        or if the padded window has no room for all samples since t1. With other paddings, the
        denoised signal begins at t2. Samples before the denoised signal and after t3 are NaN. A
        window that already has reasons is returned unchanged. A window with inconsistent fields
        gets the reason BadWindow instead of a signal.
        """
        return self.denoise_all([window])[0]

    def denoise_all(self, windows: Sequence[WeighWindow]) -> list[WeighWindow]:
        """Denoise many windows, with the same results to the last bit as those of `denoise`.

        Windows of equal shape are denoised together, in batches of limited size.
        """
        return self._failures.together(
            self._denoise_all,
            lambda window: replace(window, reasons=(Reason.STAGE_FAILED.value,)),
            windows,
        )

    def _denoise_all(self, windows: Sequence[WeighWindow]) -> list[WeighWindow]:
        result = [
            window
            if window.reasons or is_consistent(window)
            else replace(window, reasons=(Reason.BAD_WINDOW.value,))
            for window in windows
        ]
        usable = [number for number, window in enumerate(result) if not window.reasons]
        for batch in batches_of([windows[number] for number in usable], self._parameters.stretch):
            rows = denoise_batch(batch, self._parameters)
            for position, row in zip(batch.positions, rows, strict=True):
                window = windows[usable[position]]
                denoised = np.full(len(window.counts), math.nan)
                denoised[window.window_end - len(row) : window.window_end] = row
                result[usable[position]] = replace(window, denoised=denoised)
        return result


def denoise_batch(batch: WindowBatch, parameters: DenoiseParameters) -> Array:
    """Denoise windows of equal shape. The result in kg has the shape of ``batch.force``.

    The result is NaN before column ``batch.entry`` with the padding ``continuation``, and before
    column ``batch.begin`` with other paddings.
    """
    begin = batch.begin
    result = np.full(batch.force.shape, math.nan)
    if parameters.surround == 'continuation':
        result[:, batch.entry :] = _denoise_extrapolated(batch, parameters)[:, batch.entry :]
        return result
    padded, offset = pad(
        batch.force[:, begin:], parameters.stretch, parameters.surround, batch.force[:, :begin]
    )
    measured = slice(offset, offset + batch.force.shape[-1] - begin)
    result[:, begin:] = _noise_remover(measured, batch, parameters)(padded)[:, measured]
    return result


def _denoise_extrapolated(batch: WindowBatch, parameters: DenoiseParameters) -> Array:
    force, begin = batch.force, batch.begin
    count = force.shape[-1] - begin
    length = padded_length(parameters.stretch, count)
    before = (length - count) // 2 - begin
    measured = slice(before, before + force.shape[-1])
    remove_noise = _noise_remover(measured, batch, parameters)
    natural_frequency, damping_ratio = parameters.platform(batch.belt_speed)
    first, time, rise_time = batch.entry, batch.time[:, batch.entry :], batch.rise_time
    entry_fit, taps = None, None
    response = np.zeros(force.shape)
    found = np.mean(force[:, begin:], axis=-1, keepdims=True)
    for _ in range(parameters.iterations + 1):
        level = found
        # The natural frequency and the damping ratio are proportional to the inverse square root of
        # the moving mass including the product.
        moving = parameters.moving_mass
        ease = np.sqrt(moving / (moving + np.maximum(level, 0.0)))
        platform = natural_frequency * ease, damping_ratio * ease
        if parameters.edge_uncertainty:
            if entry_fit is None:
                entry_fit = EntryFit(batch, parameters.edge_uncertainty, level, *platform)
            first = 0
            time, rise_time = entry_fit.times(taps)
        response[:, first:] = load_response(time, rise_time, *platform)
        disturbance, after = force - level * response, length - measured.stop
        order = parameters.prediction_order
        padded, taps = extrapolate(disturbance, before, after, order, batch.block)
        padded += level
        denoised = remove_noise(padded)[:, measured]
        found = np.mean(denoised[:, begin:], axis=-1, keepdims=True)
    return denoised - level * (1 - batch.share)


def _noise_remover(
    measured: slice, batch: WindowBatch, parameters: DenoiseParameters
) -> Callable[[Array], Array]:
    """Return the function that denoises the padded windows of a batch."""
    if parameters.method == 'shrinkage':
        details = parameters.table.at(batch.belt_speed, parameters.threshold_unit)
        return partial(denoise_periodic, details=details)
    return partial(
        threshold_universally,
        hard=parameters.method == 'hard',
        measured=measured,
        each_level=parameters.each_level,
    )


def pad(
    samples: Array, min_length: int, method: str = 'level', before: Array | None = None
) -> tuple[Array, int]:
    """Pad windows (..., n) on both sides to a length that suits the wavelet transform.

    Returns the padded windows, (..., m), and the position in them of the first sample of the
    window. The length m is a multiple of 128, and at least `min_length` and ``2 n``.

    With the method ``level``, both sides are filled with the Hann-weighted mean of the window. With
    ``mirror``, the window is repeatedly reflected at its ends. With ``signal``, the left side is
    filled with the last samples of `before`, (..., k), and the right side with the mean. If
    `before` is too short, its first sample is repeated. If `before` is None or empty, the left side
    is also filled with the mean. No method uses samples after the window, because they are not yet
    measured when the window is denoised.

    Examples
    --------
    >>> padded, offset = pad(np.array([1.0, 2.0, 3.0]), 128, 'mirror')
    >>> offset, padded[offset - 2 : offset + 5].tolist()
    (62, [2.0, 1.0, 1.0, 2.0, 3.0, 3.0, 2.0])
    """
    count = samples.shape[-1]
    length = padded_length(min_length, count)
    offset = (length - count) // 2
    if method == 'mirror':
        sides = [(0, 0)] * (samples.ndim - 1) + [(offset, length - count - offset)]
        return np.pad(samples, sides, 'symmetric'), offset
    padded = np.empty((*samples.shape[:-1], length))
    padded[...] = np.asarray(hann_mean(samples))[..., None]
    if method == 'signal' and before is not None and before.shape[-1]:
        known = before[..., -offset:]
        padded[..., :offset] = known[..., :1]
        padded[..., offset - known.shape[-1] : offset] = known
    padded[..., offset : offset + count] = samples
    return padded, offset
