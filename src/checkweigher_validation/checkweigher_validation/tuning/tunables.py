# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning of an estimator on the passes of one belt speed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.estimators import METHODS
from checkweigher_dsp.estimation.estimators.base import Axis, Estimator
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import folds
from checkweigher_validation.tuning.search import Values, search


class TuningError(ValueError):
    """Raised if an estimator cannot be tuned on the given passes."""


def estimates_of(group: SpeedGroup, parameters: LineParameters) -> NDArray[np.float64]:
    """Return the estimates of the selected estimator before gain and offset, (n,) in kg."""
    identifier = parameters.identifier
    estimator = METHODS[identifier.estimator](identifier.chosen)
    return _masses(estimator, _windows(group, type(estimator), parameters))


class Tunable:
    """Estimator to be tuned on the passes of one belt speed, `group`.

    The class of the estimator defines which parameters are searched and which are learned.
    Subclasses are for estimators that need the passes at other speeds, a model of the machine, or
    parameters of the denoiser. `groups` contains the passes at all speeds, and `base` contains the
    start values of the tuned parameters and the values of all other parameters.
    """

    def __init__(
        self, name: str, group: SpeedGroup, base: LineParameters, groups: Sequence[SpeedGroup] = ()
    ) -> None:
        self.name = name
        self.group = group
        self.base = base
        self.others = [other for other in groups if other is not group]
        self.estimator = METHODS[name]

    @cached_property
    def windows(self) -> list[WeighWindow]:
        """Windows of the passes, denoised as in `base` if the estimator needs denoised windows."""
        return _windows(self.group, self.estimator, self.base)

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with the parameters of the estimator that are learned from all speeds.

        This class learns no such parameters, and returns `base` unchanged.
        """
        return base

    @property
    def is_closed_form(self) -> bool:
        """Whether the estimator has no searched parameters, so that tuning on a fold is fast."""
        return not self.estimator.axes

    @property
    def known(self) -> Any:
        """Parameters of the estimator in `base`."""
        return getattr(self.base.identifier, self.name)

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the values with the smallest `badness` that the search finds, and this badness.

        `badness` is evaluated about `budget` times at most, as in `search`.
        """
        axes = [replace(axis, start=self.start(axis)) for axis in self.searched()]
        return search(axes, badness, budget)

    def searched(self) -> tuple[Axis, ...]:
        """Return the axes of the search, one for each searched parameter."""
        return self.estimator.axes

    def start(self, axis: Axis) -> float:
        """Return the start value of an axis, which is the value in `base` at this speed.

        If `base` has no parameter of this name, the start value is `axis.start`.
        """
        known = self.known
        return known.at(axis.name, self.group.speed) if hasattr(known, axis.name) else axis.start

    def learn(self, rows: NDArray[np.intp], values: Mapping[str, float]) -> dict[str, Any]:
        """Return the parameters that the estimator learns from the passes `rows`, by name.

        `rows` contains the positions of these passes in `group`, and `values` contains the values
        of the searched parameters by name.
        """
        windows = [self.windows[row] for row in rows]
        return self.estimator.learn(self.known, windows, self.group.masses[rows], values)

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the estimated load of each pass before gain and offset, (n,) in kg.

        If the estimator learns parameters, each pass is weighed with the parameters that are
        learned from other passes. If the other passes are too few to learn from, the parameters are
        learned from all passes.
        """
        passes = np.arange(len(self.windows))
        fold = folds(self.group.masses, max(self.estimator.folds, 1))
        result = np.empty(len(passes))
        for number in np.unique(fold):
            others = passes[fold != number]
            taught = others if len(others) >= self.estimator.fewest else passes
            parameters = self.known.for_speed(self.group.speed, self.learn(taught, values))
            windows = [self.windows[row] for row in passes[fold == number]]
            result[fold == number] = _masses(self.estimator(parameters), windows)
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the parameters at this speed. A key has the form ``node.name``."""
        learned = self.learn(np.arange(len(self.windows)), values)
        return {f'identifier.{self.name}.{name}': numbers for name, numbers in learned.items()}


def _windows(
    group: SpeedGroup, estimator: type[Estimator], parameters: LineParameters
) -> list[WeighWindow]:
    windows = [each.window for each in group.passes]
    if estimator.needs_denoised:
        windows = Denoiser(parameters.denoise).denoise_all(windows)
    return windows


def _masses(estimator: Estimator, windows: Sequence[Any]) -> NDArray[np.float64]:
    return np.array([load.mass for load in estimator.estimate_all(windows)])
