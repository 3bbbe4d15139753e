"""What a tuner needs to know of an estimator."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.search import Axis, Values, search


class TuningError(ValueError):
    """Passes that an estimator cannot be tuned on; the message says what is missing."""


class Tunable(ABC):
    """An estimator on the passes of one belt speed.

    Parameters
    ----------
    group : SpeedGroup
        The passes.
    base : LineParameters
        Everything that is not tuned at one speed alone.

    Attributes
    ----------
    name : str
        Of the estimator.
    axes : tuple of Axis
        What is searched.
    """

    name: ClassVar[str]
    axes: ClassVar[tuple[Axis, ...]] = ()

    def __init__(self, group: SpeedGroup, base: LineParameters) -> None:
        self.group = group
        self.base = base
        self.sample_rate = group.passes[0].window.sample_rate
        samples = [raw_samples(each.window) for each in group.passes]
        lengths = np.array([len(window) for window in samples])
        # Windows of one length are computed together.
        self.batches = []
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            self.batches.append((rows, np.stack([samples[row] for row in rows])))

    def of_windows(
        self, kernel: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Return what a kernel on windows of one length, (k, n), makes of every window: (n,)."""
        result = np.empty(len(self.group.passes))
        for rows, samples in self.batches:
            result[rows] = kernel(samples)
        return result

    @abstractmethod
    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the load of every pass, before gain and offset: (n,) float64, kg."""

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with what all speeds together teach; here nothing."""
        return base

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the best values and their badness."""
        axes = [replace(axis, start=self.start(axis)) for axis in self.searched()]
        return search(axes, badness, budget)

    def searched(self) -> tuple[Axis, ...]:
        """Return what is searched from where `base` stands."""
        return self.axes

    def start(self, axis: Axis) -> float:
        """Return what `base` says at this speed: a search goes on from there."""
        known = getattr(self.base.identifier, self.name)
        return known.at(axis.name, self.group.speed) if hasattr(known, axis.name) else axis.start

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the lists of parameters at this speed, by their name with that of the node."""
        return {f'identifier.{self.name}.{name}': (value,) for name, value in values.items()}
