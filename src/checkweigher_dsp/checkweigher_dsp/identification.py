r"""Identification of the weighing platform by an extended Kalman filter (EKF).

The platform with a load on it obeys :math:`x(k) = -a_1 x(k-1) - a_2 x(k-2) + b_1 u(k-1)`, so
that the load is its steady state :math:`b_1 / (1 + a_1 + a_2)`. The filter estimates signal and
coefficients together, state :math:`X = [x(k), x(k-1), a_1, a_2, b_1]`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, repeat
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Noise:
    """Variances that the filter works with; the signal is normalised to about 1.

    Each is a float or, where many signals are identified at once, an array (passes,).

    Attributes
    ----------
    process : float
        Of x per step, Q[0, 0]; the coefficients are constant.
    measurement : float
        Of a sample, R.
    initial : float
        Of x(k), x(k-1) and b1 at the start, their entries of the diagonal P0.
    coefficients : float, optional
        Of a1 and a2 at the start; by default as the others, P0 = initial * I.
    states : float, optional
        Of x(k) and x(k-1) at the start, if not `initial`.
    """

    process: Any
    measurement: Any
    initial: Any = 1.0
    coefficients: Any = None
    states: Any = None


@dataclass(frozen=True, slots=True)
class Start:
    """The state before the first sample, X0: floats or arrays (passes,)."""

    x: Any = 0.0
    x_before: Any = 0.0
    a1: Any = 0.0
    a2: Any = 0.0
    b1: Any = 0.0


@dataclass(frozen=True, slots=True)
class Identification:
    """Coefficients after the last sample and what follows from them; floats or arrays (passes,).

    Attributes
    ----------
    a1, a2, b1 : float
        Of the difference equation.
    gain : float
        Steady state b1 / (1 + a1 + a2).
    variance : float
        Of `gain`, from the covariance of the coefficients to first order.
    """

    a1: Any
    a2: Any
    b1: Any
    gain: Any
    variance: Any


_AT_REST = Start()


def identify(
    samples: Iterable[Any],
    noise: Noise,
    inputs: Iterable[Any] | None = None,
    *,
    start: Start = _AT_REST,
    measurement: Iterable[Any] | None = None,
) -> Identification:
    r"""Identify the platform from its response to a load.

    Predict and update are the EKF with transition :math:`X' = f(X)` and its Jacobian

    .. math:: F = \begin{pmatrix} -a_1 & -a_2 & -x(k) & -x(k-1) & u \\ 1 & 0 & 0 & 0 & 0 \\
       0 & 0 & 1 & 0 & 0 \\ 0 & 0 & 0 & 1 & 0 \\ 0 & 0 & 0 & 0 & 1 \end{pmatrix}

    and C = [1 0 0 0 0], written out in scalars for the upper triangle of the symmetric covariance:
    a matrix library spends more on calls of 5 x 5 than on arithmetic. The same lines identify many
    signals at once if each sample is an array.

    Parameters
    ----------
    samples : iterable of float or of ndarray, (passes,)
        Response, normalised so that the steady state for u = 1 is about 1: start and covariance
        have no unit, so without that the result would depend on the unit of the samples.
    noise : Noise
        Variances.
    inputs : iterable of float or of ndarray, optional
        u of the step that leads to each sample; by default 1.
    start : Start
        X0; by default 0.
    measurement : iterable of float or of ndarray, optional
        R of each sample; by default that of `noise`.

    Returns
    -------
    Identification
        NaN where the filter has diverged or 1 + a1 + a2 is 0.

    References
    ----------
    Long et al., A novel dynamic weighing method integrating improved stationary wavelet denoising
    and extended Kalman system identification, eq. 5-16, with the errata in docs/method.md.
    """
    inputs = repeat(1.0) if inputs is None else inputs
    measurement = repeat(noise.measurement) if measurement is None else measurement
    state = _before(noise, start)
    return _identified(_after(state, samples, inputs, measurement, noise.process))


# x(k), x(k-1), a1, a2, b1, and the upper triangle of the covariance.
_State = tuple[Any, ...]


def _before(noise: Noise, start: Start) -> _State:
    states = noise.initial if noise.states is None else noise.states
    coefficients = noise.initial if noise.coefficients is None else noise.coefficients
    return (
        start.x, start.x_before, start.a1, start.a2, start.b1,
        states, 0.0, 0.0, 0.0, 0.0,
        states, 0.0, 0.0, 0.0,
        coefficients, 0.0, 0.0,
        coefficients, 0.0,
        noise.initial,
    )  # fmt: skip


def _after(
    state: _State, samples: Iterable[Any], inputs: Iterable[Any], measurement: Iterable[Any], q: Any
) -> _State:
    """Return the state after some samples."""
    x, y, a1, a2, b = state[:5]
    p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55 = state[5:]
    # No assignment is in place: arrays would change under their other names.
    for z, u, r in zip(samples, inputs, measurement, strict=False):
        # Row 1 of F P, then with it the first element of F P F' + Q; row 2 of that is row 1 of P.
        g1 = u * p15 - a1 * p11 - a2 * p12 - x * p13 - y * p14
        g2 = u * p25 - a1 * p12 - a2 * p22 - x * p23 - y * p24
        g3 = u * p35 - a1 * p13 - a2 * p23 - x * p33 - y * p34
        g4 = u * p45 - a1 * p14 - a2 * p24 - x * p34 - y * p44
        g5 = u * p55 - a1 * p15 - a2 * p25 - x * p35 - y * p45
        g0 = u * g5 - a1 * g1 - a2 * g2 - x * g3 - y * g4 + q
        x, y = u * b - a1 * x - a2 * y, x
        # Gain K = P C' / (C P C' + R), X + K (Z - C X), P - K C P; P C' is (g0, g1, g3, g4, g5).
        f = 1.0 / (g0 + r)
        e = f * (z - x)
        x = x + g0 * e
        y = y + g1 * e
        a1 = a1 + g3 * e
        a2 = a2 + g4 * e
        b = b + g5 * e
        k = f * g1
        p22 = p11 - k * g1
        p23 = p13 - k * g3
        p24 = p14 - k * g4
        p25 = p15 - k * g5
        k = f * g3
        p33 = p33 - k * g3
        p34 = p34 - k * g4
        p35 = p35 - k * g5
        k = f * g4
        p44 = p44 - k * g4
        p45 = p45 - k * g5
        p55 = p55 - f * g5 * g5
        h = r * f  # 1 less the gain of x, without the cancellation
        p11 = h * g0
        p12 = h * g1
        p13 = h * g3
        p14 = h * g4
        p15 = h * g5
    return (
        x, y, a1, a2, b,
        p11, p12, p13, p14, p15, p22, p23, p24, p25, p33, p34, p35, p44, p45, p55,
    )  # fmt: skip


def _identified(state: _State) -> Identification:
    _, _, a1, a2, b, *_, p33, p34, p35, p44, p45, p55 = state
    # d gain / d (a1, a2, b) = (-gain, -gain, 1) / total, once divided by total
    total = _usable(1.0 + a1 + a2)
    gain = b / total
    spread = gain * gain * (p33 + 2 * p34 + p44) - 2 * gain * (p35 + p45) + p55
    return Identification(a1, a2, b, gain, spread / total / total)


def _usable(total: Any) -> Any:
    """Return 1 + a1 + a2, NaN where nothing can be divided by it."""
    if isinstance(total, float):
        return total if total != 0 and math.isfinite(total) else math.nan
    return np.where((total != 0) & np.isfinite(total), total, np.nan)


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
    group = WindowGroup(denoised, removed_variance, loads, noise.rise)
    (found,) = _identify_groups([group], noise)
    return found


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
    state = _before(Noise(None, None, noise.initial, noise.coefficients), _AT_REST)
    result: list[tuple[Identification, Any]] = [(_NOTHING, math.nan)] * len(groups)
    begin = 0
    while signals:  # the longest first: the filter goes on without those that have ended
        end = len(signals[-1].samples)
        samples, inputs, measurement = (
            np.concatenate([getattr(each, name)[begin:end] for each in signals], axis=1)
            for name in ('samples', 'inputs', 'measurement')
        )
        state, begin = _after(state, samples, inputs, measurement, process), end
        last = signals.pop()
        count = len(process) - len(last.scale)
        result[order[len(signals)]] = _identified(_part(state, slice(count, None))), last.scale
        state, process = _part(state, slice(count)), process[:count]
    return result


def _part(state: _State, passes: slice) -> _State:
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
