"""Tuning of the Gauss-Markov estimator: its model is learned, only the order is searched."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.gauss_markov import (
    GaussMarkov,
    GaussMarkovParameters,
    pass_signal,
)
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup, spread
from checkweigher_validation.tuning.calibration import folds, held_out_errors, index
from checkweigher_validation.tuning.machine_model import fit_noise, fit_platform
from checkweigher_validation.tuning.search import Values
from checkweigher_validation.tuning.tunable import Tunable

# Of the autoregression; a line of the rollers takes about twenty to be resolved.
ORDERS = (20, 40, 80, 120, 160, 200)
_FOLDS = 2
_CHECKED_PASSES = 40  # of each speed, and with this order, on which model or none is decided
_CHECKED_ORDER = 40
_STABLE = 1 - 1e-6  # largest magnitude of a reflection coefficient: written out it is not 1


class TunedGaussMarkov(Tunable):
    """The Gauss-Markov estimator: the order of its noise model."""

    name: ClassVar[str] = 'gauss_markov'

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with the platform that the passes of all speeds fit, if it is of use."""
        known = replace(
            base.identifier.gauss_markov,
            sample_rate=groups[0].passes[0].window.sample_rate,
        )
        untrained = replace(known, sample_rate=0.0)
        chosen = min(
            (fit_platform(groups, known), untrained),
            key=lambda model: _held_out_index(groups, _with_model(base, model)),
        )
        return _with_model(base, chosen)

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the order of the smallest badness, and that."""
        known = self.base.identifier.gauss_markov
        if not self._trained:
            values = {'order': 1.0}
            return values, badness(values)
        longest = min(len(pass_signal(e.window, known).time) for e in self.group.passes) // 2
        tried: list[tuple[float, Values]] = []
        for order in ORDERS[:budget]:
            if order < longest or order == ORDERS[0]:
                values = {'order': float(order)}
                tried.append((badness(values), values))
        least, values = min(tried, key=lambda entry: entry[0])
        return values, least

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the mass of every pass in the noise that the others have taught."""
        passes = np.array(self.group.passes, dtype=object)
        if not self._trained:
            estimator = GaussMarkov(self.base.identifier.gauss_markov)
            return np.array([estimator.estimate(each.window).mass for each in passes])
        fold = folds(self.group.masses, _FOLDS)
        result = np.empty(len(passes))
        for number in range(_FOLDS):
            others = replace(self.group, passes=tuple(passes[fold != number]))
            estimator = GaussMarkov(self._model(others, round(values['order'])))
            result[fold == number] = [
                estimator.estimate(each.window).mass for each in passes[fold == number]
            ]
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the noise model of all passes, filled up with zeros to the largest order."""
        if self._trained:
            model = self._model(self.group, round(values['order']))
            rest = (0.0,) * (ORDERS[-1] - model.order)
        else:
            model, rest = GaussMarkovParameters(), ()
        return {
            'identifier.gauss_markov.reflection': model.reflection + rest,
            'identifier.gauss_markov.noise': model.noise,
            'identifier.gauss_markov.impact': model.impact,
        }

    @property
    def _trained(self) -> bool:
        return self.base.identifier.gauss_markov.sample_rate > 0

    def _model(self, group: SpeedGroup, order: int) -> GaussMarkovParameters:
        """Return the model of the machine with the noise of one speed."""
        known = self.base.identifier.gauss_markov
        reflections, std_dev, impact = fit_noise(group, known, order)
        return replace(
            known, speeds=(group.speed,), gain=(1.0,), offset=(0.0,), std_dev=(0.0,),
            relative_std_dev=(0.0,), zero_std_dev=(0.0,), order=order,
            reflection=tuple(np.clip(reflections, -_STABLE, _STABLE).tolist()),
            noise=(std_dev,), impact=(impact,),
        )  # fmt: skip


def _with_model(base: LineParameters, model: GaussMarkovParameters) -> LineParameters:
    return replace(base, identifier=replace(base.identifier, gauss_markov=model))


def _held_out_index(groups: Sequence[SpeedGroup], base: LineParameters) -> float:
    """Return A in kg on some passes that took no part in the noise they are weighed in.

    A model of the machine may be worse than none: where there are few passes, or they show little
    of the platform beside what shakes it.
    """
    indices = []
    for group in groups:
        some = replace(group, passes=tuple(spread(group, _CHECKED_PASSES)))
        estimates = TunedGaussMarkov(some, base).estimates({'order': float(_CHECKED_ORDER)})
        if not np.all(estimates > 0):  # NaN is not
            return math.inf
        indices.append(index(held_out_errors(estimates, some.masses), some.masses))
    return float(np.mean(indices))
