# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Interface of the estimators, and the parameters that all estimators have in common."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import pairwise
import math
from typing import Any, ClassVar, Self

import numpy as np

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.averages import hann_mean

_kilograms = partial(parameter, unit='kg', minimum=0, maximum=1e3)

# Ratio of the additional standard deviation beyond the trained masses to the standard deviation at
# the nearest trained mass. For a mass m above the heaviest trained mass h, the ratio is `_HEAVIER`,
# in 1/kg^2, times m (m - h). For a mass m below the lightest trained mass l, the ratio is
# `_LIGHTER` times 1 - m / l. `_HEAVIER` and `_LIGHTER` were fitted to errors on random machines
# (docs/method.md).
_HEAVIER = 18.0
_LIGHTER = 0.7

# Parameter lists that the files of earlier versions do not contain. If a list is missing, its
# default of one value holds for all speeds.
_LATER = ('lightest_mass', 'heaviest_mass')

# Largest distance of an estimate from the mean of a window: `_SPREAD` standard deviations of the
# samples, plus the fraction `_BIAS` of the mean. The term with `_BIAS` allows for parameters that
# were trained on another platform.
_SPREAD = 2.0
_BIAS = 0.02


@dataclass(frozen=True, slots=True)
class LoadEstimate:
    """Load that an estimator finds in a window, before gain and offset are applied."""

    mass: float  # load in kg, or NaN if it cannot be estimated.
    # Variance in kg^2, or NaN if it is unknown. The variance of the zero is included only if
    # `measured` is True, or if the estimate comes from a learned model of `GaussMarkov`.
    variance: float = math.nan
    # Coefficients of the platform, with b1 in kg; NaN if the estimator does not identify them.
    a1: float = math.nan
    a2: float = math.nan
    b1: float = math.nan
    # Whether the variance was measured on items, so that it includes the variance of the zero.
    measured: bool = field(default=False, kw_only=True)


@dataclass(frozen=True)
class EstimatorParameters(Parameters):
    """Parameters that all estimators have, learned from passes at one or more belt speeds.

    Each list has one value for each of ``speeds``, except lists for which a subclass overrides
    `fits`. The values are interpolated linearly between the speeds, and constant beyond them.
    ``lightest_mass`` and ``heaviest_mass`` may have one value for all speeds.

    Raises
    ------
    ParameterError
        If the speeds do not increase, there is no speed, or a list has a wrong number of values.
    """

    calibrated: bool = parameter(False, 'whether the lists below come from training passes')
    training: str = parameter('', 'description of the training passes: bags, number, belt speeds')
    speeds: tuple[float, ...] = parameter(
        (1.0,), 'belt speeds of the lists below, ascending', unit='m/s', minimum=1e-3, maximum=100
    )
    gain: tuple[float, ...] = parameter(
        (1.0,), 'the mass is gain times the estimate, plus offset', minimum=0.1, maximum=10
    )
    offset: tuple[float, ...] = parameter(
        (0.0,), 'offset of the mass; see gain', unit='kg', minimum=-1e3, maximum=1e3
    )
    std_dev: tuple[float, ...] = _kilograms(
        (0.0,),
        'standard deviation of the mass on training passes: the part that is the same for all '
        'masses',
    )
    relative_std_dev: tuple[float, ...] = parameter(
        (0.0,),
        'standard deviation of the mass on training passes: the part in proportion to the mass, as '
        'a fraction of the mass',
        minimum=0,
        maximum=10,
    )
    zero_std_dev: tuple[float, ...] = _kilograms(
        (0.0,), 'standard deviation of the zero on training passes, as computed by the segmenter'
    )
    lightest_mass: tuple[float, ...] = _kilograms(
        (0.0,),
        'smallest mass of the training passes; below it, the stated standard deviation grows',
    )
    heaviest_mass: tuple[float, ...] = _kilograms(
        (1e3,),
        'largest mass of the training passes; above it, the stated standard deviation grows',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.speeds or any(a >= b for a, b in pairwise(self.speeds)):
            raise ParameterError(
                f'{self.node}.speeds: at least one speed is needed, in increasing order'
            )
        for entry in fields(self):
            values = getattr(self, entry.name)
            if not isinstance(values, tuple) or (entry.name in _LATER and len(values) == 1):
                continue
            if not self.fits(entry.name, len(values)):
                raise ParameterError(
                    f'{self.node}.{entry.name}: {len(values)} values for {len(self.speeds)} speeds'
                )

    def fits(self, name: str, count: int) -> bool:
        """Return whether the list `name` may have `count` values.

        By default, a list must have one value for each of ``speeds``.
        """
        return count == len(self.speeds)

    def at(self, name: str, speed: float) -> float:
        """Return the value of the list `name` at a belt speed in m/s."""
        values = getattr(self, name)
        return float(np.interp(speed, self.speeds, values) if len(values) > 1 else values[0])

    def for_speed(self, speed: float, lists: Mapping[str, Any]) -> Self:
        """Return uncalibrated parameters for one belt speed in m/s, with the given `lists`.

        Parameters of `EstimatorParameters` get their default values, and parameters of the subclass
        are kept, unless `lists` contains them.
        """
        common = {entry.name: entry.default for entry in fields(EstimatorParameters)}
        return replace(self, **{**common, 'speeds': (speed,), **lists})

    def row_at(self, name: str, speed: float) -> Array:
        """Return the values of the list `name` at a belt speed in m/s, (k,).

        The list has k values for each of ``speeds``, one speed after the other.
        """
        table = np.reshape(getattr(self, name), (len(self.speeds), -1))
        return np.array([np.interp(speed, self.speeds, column) for column in table.T])

    def extrapolation_std_dev(self, mass: float, speed: float) -> float:
        """Return the additional standard deviation in kg of a mass beyond the trained masses.

        `mass` is in kg and `speed` in m/s. A heavier product swings more slowly, so its estimate
        has a systematic error that the training passes do not show. To first order, the systematic
        error is proportional to the mass and to its distance from the trained masses. The scatter
        of a lighter product is uncertain, because passes of one mass do not show how the scatter
        depends on the mass. The result is proportional to the standard deviation at the nearest
        trained mass. The result is 0 between the lightest and the heaviest trained mass, and for a
        mass that is not positive.
        """
        lightest, heaviest = self.at('lightest_mass', speed), self.at('heaviest_mass', speed)
        if mass > heaviest:
            nearest, growth = heaviest, _HEAVIER * mass * (mass - heaviest)
        elif 0 < mass < lightest:
            nearest, growth = lightest, _LIGHTER * (1 - mass / lightest)
        else:
            return 0.0
        relative = self.at('relative_std_dev', speed) * nearest
        return growth * math.hypot(self.at('std_dev', speed), relative)

    def is_trained(self, speed: float, tolerance: float) -> bool:
        """Return whether a speed in m/s is in the range of ``speeds``.

        `tolerance` extends the range on both sides, as a fraction of its bounds.
        """
        slowest, fastest = self.speeds[0], self.speeds[-1]
        return slowest * (1 - tolerance) <= speed <= fastest * (1 + tolerance)


@dataclass(frozen=True, slots=True)
class Axis:
    """Parameter whose value the command `tune` searches from `low` to `high`, both included.

    The search begins at `start`, which may be outside the range. A `logarithmic` axis is searched
    by factors instead of differences, and a `whole` axis by integers only.
    """

    name: str
    low: float
    high: float
    start: float
    logarithmic: bool = False
    whole: bool = False


@dataclass(frozen=True, slots=True)
class PlotStyle:
    """Name and marker of an estimator in plots, with colours for light and dark pages."""

    label: str
    marker: str
    light: str
    dark: str


class Estimator(ABC):
    """Method that estimates the load in weigh windows."""

    parameters: EstimatorParameters  # The attribute of the class contains the default parameters.
    needs_denoised: ClassVar[bool] = False  # whether `estimate` uses the denoised signal.
    # Python package that the estimator needs, but package.xml omits because apt does not offer it.
    package: ClassVar[str] = ''
    look: ClassVar[PlotStyle | None] = None  # style in reports, by default chosen automatically.
    # Axes that the command `tune` searches. Unless `learn` is overridden, each axis has the name of
    # the parameter list that it sets.
    axes: ClassVar[tuple[Axis, ...]] = ()
    # Number of folds of the cross-validation by `tune`, or 0 if `learn` does not use the passes.
    folds: ClassVar[int] = 0
    fewest: ClassVar[int] = 1  # smallest number of passes from which the estimator can learn

    def __init__(self, parameters: Any) -> None:
        self.parameters = parameters

    @abstractmethod
    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the load in a window, before gain and offset are applied."""

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[LoadEstimate]:
        """Return the load in each window, with the same results to the last bit as `estimate`."""
        return [self.estimate(window) for window in windows]

    @classmethod
    def learn(
        cls, known: Any, windows: Sequence[WeighWindow], masses: Array, values: Mapping[str, float]
    ) -> dict[str, tuple[float, ...]]:
        """Learn lists of parameters from passes at one belt speed, and return them by name.

        `known` are the previous parameters, and `masses`, (windows,), the true masses in kg.
        `values` contains, by the name of the axis, the value of each of `axes` that the command
        `tune` tries. By default, each value in `values` is returned as a list of one value.
        """
        return {name: (value,) for name, value in values.items()}


class Average(Estimator):
    """Estimator that averages the raw samples from t2 to t3."""

    @abstractmethod
    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the average in kg of the samples of a window, (n,), or NaN if it is undefined."""

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the average of the window as the load, with the variance by `rough_variance`."""
        samples = raw_samples(window)
        return LoadEstimate(float(self.average(samples, window)), rough_variance(samples))


def raw_samples(window: WeighWindow) -> Array:
    """Return the raw signal from t2 to t3 in kg relative to the zero, (n,) float64."""
    return window.force_between(window.window_begin, window.window_end)


def rough_variance(samples: Array) -> float:
    """Estimate the variance of an average in kg^2 without training.

    The estimate uses the difference between the averages of the two halves of the samples, (n,) in
    kg. The variance of the samples divided by their number is added, because the halves may agree
    by chance. The result is NaN for a single sample.
    """
    half = len(samples) // 2
    difference = hann_mean(samples[:half]) - hann_mean(samples[-half:])
    return float(difference * difference / 4 + np.var(samples) / len(samples))


def is_in_window(load: LoadEstimate, window: WeighWindow) -> bool:
    """Return whether a load is close to the mean of the raw samples from t2 to t3.

    An estimator may assume a certain rise of the load. If the actual rise is different, because the
    belt stops or an unseen object leaves the belt, the estimate may be far from the mean.
    """
    samples = raw_samples(window)
    level = float(np.mean(samples))
    return abs(load.mass - level) <= _SPREAD * float(np.std(samples)) + _BIAS * abs(level)
