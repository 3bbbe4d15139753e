"""Identification of the platform in weigh windows: one, or many at once with the same bits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.signal.extended_kalman import (
    Identification,
    Noise,
    Start,
    State,
    identified_by,
    identify,
    state_after,
    state_before,
)


@dataclass(frozen=True, slots=True)
class WindowNoise:
    """Variances of a window without a unit: shares of what denoising has removed from it.

    Attributes
    ----------
    measurement : float
        R as a share of the variance that denoising removed.
    process : float
        Q as a multiple of R.
    initial, coefficients : float
        P0, see `Noise`; the signal is normalised to 1.
    rise : float or ndarray, (passes,)
        R while the load rises, as a multiple of R: no product comes onto the belt quite evenly.
    """

    measurement: float = 0.25
    process: float = 0.01
    initial: float = 1.0
    coefficients: float = 1e-6
    rise: Any = 10.0


def identify_window(
    denoised: NDArray[np.float64],
    removed_variance: Any,
    inputs: NDArray[np.float64] | None,
    noise: WindowNoise,
) -> Identification:
    """Identify the platform from denoised windows, in the unit of the signal.

    The signal is normalised by its mean under full load, and the noise that the filter works with
    is a share of what denoising took out of this very window: both without a unit.

    Parameters
    ----------
    denoised : ndarray, (n,) or (passes, n) float64
        From t1 or from t2 on, up to t3.
    removed_variance : float or ndarray, (passes,)
        Variance that denoising took out between t2 and t3, in the unit of `denoised` squared.
    inputs : ndarray of the shape of `denoised`, or None
        Share of the load at each sample, ascending to 1 at t2; None for 1 throughout.
    noise : WindowNoise
        Its shares.

    Returns
    -------
    Identification
        ``gain`` and ``b1`` in the unit of `denoised`, ``variance`` in its square: floats for one
        window, arrays (passes,) for several. NaN where there is nothing to identify.
    """
    work = _identify_one if denoised.ndim == 1 else _identify_several
    with np.errstate(all='ignore'):
        return _in_unit(*work(denoised, removed_variance, inputs, noise))


def _in_unit(found: Identification, scale: Any) -> Identification:
    """Return what was found in signals that had been divided by `scale`."""
    return Identification(
        found.a1, found.a2, scale * found.b1, scale * found.gain, scale * scale * found.variance
    )


def _identify_one(
    denoised: NDArray[np.float64],
    removed_variance: float,
    inputs: NDArray[np.float64] | None,
    noise: WindowNoise,
) -> tuple[Identification, float]:
    """Return what `_identify_several` does for each window, to the last bit, in plain floats."""
    full = denoised if inputs is None else denoised * (inputs >= 1.0)
    rise = 0 if inputs is None else int(np.count_nonzero(inputs < 1.0))
    # Plain floats: arithmetic on those of numpy takes several times as long.
    scale = float(np.add.reduce(full) / (len(full) - rise)) if len(full) > rise else math.nan
    if not math.isfinite(scale) or scale == 0:
        return _NOTHING, math.nan
    relative = float(max(noise.measurement * removed_variance / scale / scale, _LEAST))
    found = identify(
        (denoised / scale).tolist(),
        Noise(noise.process * relative, relative, noise.initial, noise.coefficients),
        None if inputs is None else chain(inputs[:rise].tolist(), repeat(1.0)),
        measurement=chain(repeat(noise.rise * relative, rise), repeat(relative)),
    )
    return found, scale


_NOTHING = Identification(*(math.nan,) * 5)


def _identify_several(
    denoised: NDArray[np.float64],
    removed_variance: Any,
    inputs: NDArray[np.float64] | None,
    noise: WindowNoise,
) -> tuple[Identification, Any]:
    """Return what is identified in windows at once and by what each was divided, (passes,)."""
    loads = np.ones(denoised.shape) if inputs is None else inputs
    if len(denoised) >= FEW:
        group = WindowGroup(denoised, removed_variance, loads, noise.rise)
        return _identify_groups([group], noise)[0]
    removed, rises = (
        np.broadcast_to(values, len(denoised)).tolist() for values in (removed_variance, noise.rise)
    )
    rows = []
    for samples, variance, load, rise in zip(denoised, removed, loads, rises, strict=True):
        one, scale = _identify_one(samples, variance, load, replace(noise, rise=rise))
        rows.append((one.a1, one.a2, one.b1, one.gain, one.variance, scale))
    a1, a2, b1, gain, variances, scales = np.array(rows).reshape(-1, 6).T
    return Identification(a1, a2, b1, gain, variances), scales


# Fewer windows than these are identified faster one by one: arithmetic on arrays costs by the call.
FEW = 32


@dataclass(frozen=True, slots=True)
class WindowGroup:
    """Windows of equal length, see `identify_window`.

    Attributes
    ----------
    denoised, inputs : ndarray, (passes, n) float64
        Signals, and share of the load at each sample.
    removed_variance, rise : float or ndarray, (passes,)
        What denoising took out, and `WindowNoise.rise`.
    """

    denoised: NDArray[np.float64]
    removed_variance: Any
    inputs: NDArray[np.float64]
    rise: Any


def identify_groups(groups: Sequence[WindowGroup], noise: WindowNoise) -> list[Identification]:
    """Return what `identify_window` makes of each group of windows, to the last bit.

    All of them at once: each step of the filter costs by the call rather than by the window.

    Parameters
    ----------
    groups : sequence of WindowGroup
        The windows, by length.
    noise : WindowNoise
        Its shares; `rise` is that of the groups.
    """
    with np.errstate(all='ignore'):
        return [_in_unit(found, scale) for found, scale in _identify_groups(groups, noise)]


def _identify_groups(
    groups: Sequence[WindowGroup], noise: WindowNoise
) -> list[tuple[Identification, Any]]:
    """Return what is identified in each group and by what each of its windows was divided."""
    order = sorted(range(len(groups)), key=lambda number: -groups[number].denoised.shape[-1])
    signals = [_normalised(groups[number], noise.measurement) for number in order]
    process = noise.process * np.concatenate([each.relative for each in signals])
    state = state_before(Noise(None, None, noise.initial, noise.coefficients), Start())
    result: list[tuple[Identification, Any]] = [(_NOTHING, math.nan)] * len(groups)
    begin = 0
    while signals:  # the longest first: the filter goes on without those that have ended
        end = len(signals[-1].samples)
        samples, inputs, measurement = (
            np.concatenate([getattr(each, name)[begin:end] for each in signals], axis=1)
            for name in ('samples', 'inputs', 'measurement')
        )
        state, begin = state_after(state, samples, inputs, measurement, process), end
        last = signals.pop()
        count = len(process) - len(last.scale)
        result[order[len(signals)]] = identified_by(_part(state, slice(count, None))), last.scale
        state, process = _part(state, slice(count)), process[:count]
    return result


def _part(state: State, passes: slice) -> State:
    return tuple(each[passes] for each in state)


@dataclass(frozen=True, slots=True)
class _Signals:
    """Windows divided by their scale: samples, loads and R, (n, passes), and R at rest."""

    samples: NDArray[np.float64]
    inputs: NDArray[np.float64]
    measurement: NDArray[np.float64]
    relative: NDArray[np.float64]
    scale: NDArray[np.float64]


def _normalised(group: WindowGroup, measurement: float) -> _Signals:
    full = group.inputs >= 1.0
    scale = np.add.reduce(group.denoised * full, axis=-1) / np.count_nonzero(full, axis=-1)
    scale = np.where(np.isfinite(scale) & (scale != 0), scale, np.nan)
    relative = np.maximum(measurement * group.removed_variance / scale / scale, _LEAST)
    inputs = np.ascontiguousarray(group.inputs.T)
    return _Signals(
        np.ascontiguousarray((group.denoised / scale[:, None]).T),
        inputs,
        np.where(inputs < 1.0, group.rise * relative, relative),
        relative,
        scale,
    )


# Relative variance that even a noise-free signal is credited with: the filter stays regular.
_LEAST = 1e-12
