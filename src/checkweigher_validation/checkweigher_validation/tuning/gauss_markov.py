# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning of the Gauss-Markov estimator: the model is learned, and its order is searched.

First, the platform is fitted to passes of known mass by nonlinear least squares; an autoregression
of the empty belt whitens the noise. Then the noise is learned from the residuals of the training
passes.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

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

# Orders of the autoregression; to resolve a line of the rollers takes about twenty.
ORDERS = (20, 40, 80, 120, 160, 200)
_CHECKED_PASSES = 40  # of each speed, to decide whether to use the model
_CHECKED_ORDER = 40
_STABLE = 1 - 1e-6  # largest magnitude of a reflection coefficient, not rounded to 1 in a file
_FIRST_ORDER = 40
_PASSES_FOR_PLATFORM = 20  # of each speed
_PASSES_FOR_START = 4
_FREQUENCIES = np.geomspace(8.0, 120.0, 28)  # Hz, where the search for the platform begins
_LEAST_NOISE = 1e-9  # kg
_FREE = (1.0, 1.0, 1.0, 1.0, 1.0)  # kg, prior std. dev. of oscillations and zero: unknown
# Searched: ln f_n, ln xi, ln (moving mass / heaviest product), entry_begin and entry_end in mm.
_LOWEST = np.array([math.log(2.0), math.log(1e-3), math.log(1.0), -20.0, -20.0])
_HIGHEST = np.array([math.log(300.0), math.log(0.5), math.log(1e3), 20.0, 20.0])


class TunedGaussMarkov(Tunable):
    """The Gauss-Markov estimator: the order of its noise model is searched."""

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with a platform fitted to the passes of all speeds, if that lowers A."""
        sample_rate = groups[0].passes[0].window.sample_rate
        known = replace(base.identifier.gauss_markov, sample_rate=sample_rate)
        models = fit_platform(groups, known), replace(known, sample_rate=0.0)
        sets = [base.identifier.with_set('gauss_markov', model) for model in models]
        lines = [replace(base, identifier=each) for each in sets]
        return min(lines, key=lambda line: _held_out_index(groups, line))

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the order with the smallest badness, and the badness."""
        if not self.known.sample_rate:
            return {}, badness({})
        longest = min(len(pass_signal(window, self.known).time) for window in self.windows) // 2
        orders = [order for order in ORDERS[:budget] if order < longest or order == ORDERS[0]]
        least, order = min((badness({'order': order}), order) for order in orders)
        return {'order': float(order)}, least

    def learn(self, rows: NDArray[np.intp], values: Mapping[str, float]) -> dict[str, Any]:
        """Return the noise model of some of the passes, with its order."""
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
    """Return A in kg on some passes, weighed with a noise model from other passes.

    A model of the machine may be worse than none if there are few passes, or if its disturbances
    hide the platform.
    """
    indices = []
    for group in groups:
        some = replace(group, passes=tuple(evenly_chosen(group, _CHECKED_PASSES)))
        tunable = TunedGaussMarkov('gauss_markov', some, base)
        estimates = tunable.estimates({'order': _CHECKED_ORDER})
        if not np.all(estimates > 0):  # also if one is NaN
            return math.inf
        indices.append(index(held_out_errors(estimates, some.masses), some.masses))
    return float(np.mean(indices))


def fit_platform(
    groups: Sequence[SpeedGroup], known: GaussMarkovParameters
) -> GaussMarkovParameters:
    """Return `known` with the platform and the places of entry that fit the passes best.

    Raises TuningError if the passes are too short or hold no noise.
    """
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
        # The samples stay the same while the entry is searched.
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
    """Fit the noise of the passes of one speed, given a model of the platform.

    Returns the reflection coefficients of an autoregression, (order,), the standard deviation of
    its innovations in kg, and the impact in s/m: the oscillation from the entry on, per mass and
    speed. Raises TuningError if the passes are too short for the order or hold no noise.
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
    """Return the residual of the model on a pass of known mass, in time and whitened, (n,), kg.

    Also returns the coefficients of the oscillations and the zero, and their variances, (5,).
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
    """Return the filter that makes the noise of the empty belt white.

    If the belt is never empty for long enough, the noise of the loaded belt about its mean is used,
    which includes the vibration of the product.
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
    """Return the autoregression of noise, or raise TuningError if there is none."""
    try:
        # The rounding of a constant is not noise.
        if max(float(np.ptp(segment)) for segment in segments) < _LEAST_NOISE:
            raise ValueError('the signals hold no noise')
        return pooled_reflections(segments, order)
    except ValueError as error:
        raise TuningError(f'gauss_markov at {60 * group.speed:.1f} m/min: {error}') from None
