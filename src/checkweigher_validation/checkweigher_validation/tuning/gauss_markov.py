# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning of the Gauss-Markov estimator, which has a model of the platform and a model of the noise.

First, the model of the platform is fitted to passes of known mass by nonlinear least squares. For
this fit, the noise is whitened with an autoregression of the empty-belt signal. Then the noise
model is learned from the residuals of the passes. The order of the noise model is found by a
search.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.gauss_markov import (
    GaussMarkovParameters,
    PassSignal,
    pass_signal,
)
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.platform_response import responses
from checkweigher_dsp.signal.prewhitening import Prewhitener, pooled_reflections
from checkweigher_validation.accuracy.passes import KnownPass, SpeedGroup, evenly_chosen
from checkweigher_validation.tuning.calibration import held_out_errors, index
from checkweigher_validation.tuning.search import Values
from checkweigher_validation.tuning.tunables import Tunable, TuningError

# Orders of the autoregression that the search compares. An order of about 20 is needed to resolve a
# spectral line of the rollers.
ORDERS = (20, 40, 80, 120, 160, 200)
_CHECKED_PASSES = 40  # number of passes of each speed to decide whether the platform model is used
_CHECKED_ORDER = 40
# Largest magnitude of a reflection coefficient. A value closer to 1 would be rounded to 1 in the
# parameter file, and the identifier refuses 1.
_STABLE = 1 - 1e-6
_FIRST_ORDER = 40
_PASSES_FOR_PLATFORM = 20  # number of passes of each speed to fit the platform
_PASSES_FOR_START = 4
_FREQUENCIES = np.geomspace(8.0, 120.0, 28)  # natural frequencies in Hz to start the fit with
_LEAST_NOISE = 1e-9  # smallest peak-to-peak value in kg of a signal that is considered noisy.
# Wide prior standard deviations in kg of the four oscillation coefficients and of the zero.
_FREE = (1.0, 1.0, 1.0, 1.0, 1.0)
# Bounds of the fitted values: ln(natural frequency in Hz), ln(damping ratio), ln(moving mass /
# heaviest product), and the parameters entry_begin and entry_end in mm.
_LOWEST = np.array([math.log(2.0), math.log(1e-3), math.log(1.0), -20.0, -20.0])
_HIGHEST = np.array([math.log(300.0), math.log(0.5), math.log(1e3), 20.0, 20.0])


class TunedGaussMarkov(Tunable):
    """Tuning of the Gauss-Markov estimator on the passes of one belt speed."""

    @property
    def is_closed_form(self) -> bool:
        """Always False, because the order of the noise model is searched."""
        return False

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with a platform fitted to the passes of all speeds, if this lowers A.

        A is computed on held-out passes. If the platform model does not lower A, the estimator gets
        no platform model, and its parameter `sample_rate` is set to 0. Raises `TuningError` if the
        passes are too short or have no noise.
        """
        sample_rate = groups[0].passes[0].window.sample_rate
        known = replace(base.identifier.gauss_markov, sample_rate=sample_rate)
        models = fit_platform(groups, known), replace(known, sample_rate=0.0)
        sets = [base.identifier.with_set('gauss_markov', model) for model in models]
        lines = [replace(base, identifier=each) for each in sets]
        return min(lines, key=lambda line: _held_out_index(groups, line))

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the order of the noise model with the smallest badness, and this badness.

        Without a platform model, the returned values are empty, because the order is not used.
        """
        if not self.known.sample_rate:
            return {}, badness({})
        longest = min(len(pass_signal(window, self.known).time) for window in self.windows) // 2
        orders = [order for order in ORDERS[:budget] if order < longest or order == ORDERS[0]]
        least, order = min((badness({'order': order}), order) for order in orders)
        return {'order': float(order)}, least

    def learn(self, rows: NDArray[np.intp], values: Mapping[str, float]) -> dict[str, Any]:
        """Return the noise model of the passes `rows`, or the default without a platform model."""
        if not self.known.sample_rate:
            names = ('order', 'reflection', 'noise', 'impact')
            return {name: getattr(GaussMarkovParameters(), name) for name in names}
        group = replace(self.group, passes=tuple(self.group.passes[row] for row in rows))
        order = round(values['order'])
        reflections, std_dev, impact = fit_noise(group, self.known, order)
        reflection = tuple(np.clip(reflections, -_STABLE, _STABLE).tolist())
        return {'order': order, 'reflection': reflection, 'noise': (std_dev,), 'impact': (impact,)}

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the noise model of all passes, padded with zeros to the largest order."""
        model = self.learn(np.arange(len(self.windows)), values)
        order = model.pop('order')
        if self.known.sample_rate:
            model['reflection'] += (0.0,) * (ORDERS[-1] - order)
        return {f'identifier.gauss_markov.{name}': numbers for name, numbers in model.items()}


def _held_out_index(groups: Sequence[SpeedGroup], base: LineParameters) -> float:
    """Return A in kg on some passes, each of which is weighed with a noise model of other passes.

    A is infinite if a pass gets no mass. A comparison of A with and without a platform model shows
    whether the model is useful. A platform model may increase the errors if there are few passes,
    or if disturbances mask the response of the platform.
    """
    indices = []
    for group in groups:
        some = replace(group, passes=tuple(evenly_chosen(group, _CHECKED_PASSES)))
        tunable = TunedGaussMarkov('gauss_markov', some, base)
        estimates = tunable.estimates({'order': _CHECKED_ORDER})
        if not np.all(estimates > 0):  # an estimate of NaN also counts as a failure
            return math.inf
        indices.append(index(held_out_errors(estimates, some.masses), some.masses))
    return float(np.mean(indices))


def fit_platform(
    groups: Sequence[SpeedGroup], known: GaussMarkovParameters
) -> GaussMarkovParameters:
    """Return `known` with the platform and the entry positions that fit the passes best.

    Raises `TuningError` if the passes are too short or have no noise.
    """
    from scipy.optimize import least_squares  # imported late, because the import is slow

    whiteners = {group.speed: _first_whitener(group, known) for group in groups}
    heaviest = max(float(group.masses.max()) for group in groups)

    def parameters(values: NDArray[np.float64]) -> GaussMarkovParameters:
        frequency, damping, mass = np.exp(values[:3])
        return replace(
            known,
            natural_frequency=float(frequency),
            damping_ratio=float(damping),
            moving_mass=float(mass) * heaviest,
            entry_begin=float(values[3]) / 1000,
            entry_end=float(values[4]) / 1000,
        )

    def chosen(count: int) -> list[tuple[Prewhitener, KnownPass, PassSignal]]:
        # Choose the samples only once, with the entry positions in `known`, because the residuals
        # must be of the same samples in each step of the fit.
        return [
            (whiteners[group.speed], each, pass_signal(each.window, known))
            for group in groups
            for each in evenly_chosen(group, count)
        ]

    def misfit(values: NDArray[np.float64], passes: Any) -> NDArray[np.float64]:
        model = parameters(values)
        residuals = []
        for white, each, used in passes:
            moved = replace(used, crossing=pass_signal(each.window, model).crossing)
            residuals.append(_residual(moved, each.mass, model, white)[1])
        return np.concatenate(residuals)

    few = chosen(_PASSES_FOR_START)
    rest = (math.log(0.05), math.log(10.0), 0.0, 0.0)
    starts = [np.array([math.log(frequency), *rest]) for frequency in _FREQUENCIES]
    start = min(starts, key=lambda values: float(np.sum(misfit(values, few) ** 2)))
    found = least_squares(
        misfit,
        start,
        bounds=(_LOWEST, _HIGHEST),
        x_scale=(0.05, 0.3, 1, 1, 1),
        xtol=1e-6,
        ftol=1e-8,
        max_nfev=30,
        args=(chosen(_PASSES_FOR_PLATFORM),),
    )
    return parameters(found.x)


def fit_noise(
    group: SpeedGroup, known: GaussMarkovParameters, order: int
) -> tuple[NDArray[np.float64], float, float]:
    """Fit a noise model to the passes of one speed, given a platform model.

    Returns the reflection coefficients of an autoregression, (order,), the standard deviation of
    its innovations in kg, and the impact in s/m. The impact is the amplitude of the oscillation
    after the entry, divided by the mass and the belt speed. Raises `TuningError` if the passes are
    too short for the order or have no noise.
    """
    whitener = _first_whitener(group, known)
    residuals, kicks = [], []
    for each in group.passes:
        used = pass_signal(each.window, known)
        left, _, coefficients, variances = _residual(used, each.mass, known, whitener)
        residuals.append(left)
        scale = each.mass * each.window.belt_speed
        kicks.append((coefficients[2:4] ** 2 - variances[2:4]) / scale**2)
    reflections, std_dev = _reflections(residuals, order, group)
    return reflections, std_dev, math.sqrt(max(float(np.mean(kicks)), 0.0))


def _residual(
    used: PassSignal, mass: float, known: GaussMarkovParameters, whitener: Prewhitener
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the residual of the platform model on a pass of known mass.

    Returns the residual, (n,) in kg, the whitened residual, (n,) in kg, and the coefficients of the
    oscillations and the zero with their variances, (5,) each.
    """
    load, *others = responses(known.platform, mass, used.crossing, used.time)
    signal = used.signal - mass * load
    columns = np.vstack((*others, np.ones(len(signal))))
    white_signal, white_columns = whitener.whiten(signal), whitener.whiten(columns)
    inverse = np.linalg.inv(white_columns @ white_columns.T + np.diag(np.array(_FREE) ** -2.0))
    coefficients = inverse @ (white_columns @ white_signal)
    left = signal - coefficients @ columns
    return left, white_signal - coefficients @ white_columns, coefficients, np.diag(inverse)


def _first_whitener(group: SpeedGroup, known: GaussMarkovParameters) -> Prewhitener:
    """Return the filter that whitens the noise of the empty belt at the speed of `group`.

    If the belt is never empty for long enough, the signal of the loaded belt is used instead.
    Raises `TuningError` if the signals contain no noise or are too short.
    """
    empty, full = [], []
    for each in group.passes:
        used = pass_signal(each.window, known)
        before = used.signal[used.time < used.crossing.on_begin]
        window = used.signal[used.time >= used.crossing.on_end]
        if len(before) > _FIRST_ORDER:
            empty.append(before - np.mean(before))
        full.append(window - np.mean(window))
    return Prewhitener(*_reflections(empty or full, _FIRST_ORDER, group))


def _reflections(
    segments: Sequence[NDArray[np.float64]], order: int, group: SpeedGroup
) -> tuple[NDArray[np.float64], float]:
    """Return the reflection coefficients and the innovation standard deviation of noise signals.

    The signals `segments` are in kg. Returns the coefficients, (order,), and the standard deviation
    in kg. Raises `TuningError`, with the speed of `group` in its message, if the signals contain no
    noise or are too short for the order.
    """
    try:
        # Rounding errors of a constant signal are not regarded as noise.
        if max(float(np.ptp(segment)) for segment in segments) < _LEAST_NOISE:
            raise ValueError('the signals contain no noise')
        return pooled_reflections(segments, order)
    except ValueError as error:
        raise TuningError(f'gauss_markov at {60 * group.speed:.1f} m/min: {error}') from None
