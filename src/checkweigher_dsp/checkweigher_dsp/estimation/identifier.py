# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimation of the masses of items from their weigh windows, by the selected estimator."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass, replace
import hashlib
from importlib.util import find_spec
import json
import math
from typing import Any, ClassVar, Self, cast

from checkweigher_core.parameters import Parameters, package_missing, parameter
from checkweigher_core.records import MassEstimate, WeighWindow
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.denoising.window_batch import is_consistent
from checkweigher_dsp.estimation.estimators import ESTIMATORS, METHODS, REFERENCES
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    is_in_window,
)
from checkweigher_dsp.estimation.learning.learner import (
    LearnedKinds,
    LearningParameters,
    learn,
    learned_load,
)
from checkweigher_dsp.estimation.plausibility import is_plausible
from checkweigher_dsp.items.failures import PRINTED, Failures
from checkweigher_dsp.signal.extended_kalman import is_stable, platform_poles


@dataclass(frozen=True)
class _OwnParameters(Parameters):
    node: ClassVar[str] = 'identifier'

    estimator: str = parameter('iswd_eksi', 'estimator of the mass', choices=tuple(ESTIMATORS))
    max_relative_std_dev: float = parameter(
        0.25,
        'largest standard deviation as a fraction of the mass; above it, the item gets no mass, '
        'with the reason NoConvergence',
        minimum=0,
        maximum=1e9,
    )
    speed_tolerance: float = parameter(
        0.03,
        'largest relative distance of the belt speed from the range of the trained speeds; beyond '
        'it, the item gets no mass, with the reason SpeedNotTrained',
        minimum=0,
        maximum=1e9,
    )
    learn: bool = parameter(
        False,
        'whether to learn weights from products of unknown mass during operation, and to use them '
        'for the mass where they are more precise than the estimator',
    )
    learning: LearningParameters = LearningParameters()


def _with_sets(base: Any, estimators: Mapping[str, type[Estimator]]) -> Any:
    """Return a subclass of a parameter class, with one more field for each of the estimators.

    Each added field has the name of an estimator, and by default contains the default parameters of
    this estimator. The return type is Any, because a type checker does not see the added fields.
    """
    sets = [
        (name, type(each.parameters), field(default=each.parameters))
        for name, each in estimators.items()
    ]
    return make_dataclass(f'{base.__name__}AndSets', sets, bases=(base,), frozen=True)


_AllParameters: Any = _with_sets(_OwnParameters, ESTIMATORS)


@dataclass(frozen=True)
class IdentifierParameters(_AllParameters, _OwnParameters):
    """Parameters of the identifier, with a set of parameters for each of `ESTIMATORS`.

    Raises
    ------
    ParameterError
        If a value is not allowed, or the selected estimator needs a Python package that is missing.
    """

    def __post_init__(self) -> None:
        super().__post_init__()
        package = METHODS[self.estimator].package
        if package and find_spec(package) is None:
            raise package_missing('identifier.estimator', self.estimator, package)

    @property
    def chosen(self) -> EstimatorParameters:
        """Parameters of the selected estimator."""
        return cast(EstimatorParameters, getattr(self, self.estimator))

    def with_set(self, estimator: str, parameters: EstimatorParameters) -> Self:
        """Return a copy in which `parameters` replace the parameters of one estimator."""
        changes: dict[str, Any] = {estimator: parameters}
        return replace(self, **changes)

    @property
    def basis(self) -> str:
        """Name of the selected estimator and hash of its parameters.

        A learned state is used only with the basis with which it was learned.
        """
        values = json.dumps(self.chosen.as_mapping(), sort_keys=True)
        return f'{self.estimator} {hashlib.sha256(values.encode()).hexdigest()[:16]}'


_WithReferences: Any = _with_sets(IdentifierParameters, REFERENCES)


@dataclass(frozen=True)
class ComparedParameters(_WithReferences, IdentifierParameters):
    """Parameters of an identifier that may also select an estimator of `REFERENCES`."""

    estimator: str = parameter('iswd_eksi', 'estimator of the mass', choices=tuple(METHODS))


class Identifier:
    """Stage that estimates the mass of each item from its weigh window.

    With `IdentifierParameters.learn`, the stage learns weights from each weighed window, and uses
    them for later windows if they are more precise than the estimator. `known`, the learned state
    of an earlier process, is ignored if it belongs to another estimator or to other parameters. If
    a window causes an exception, `failures` reports it, and the item gets no mass, with the reason
    StageFailed.

    Examples
    --------
    >>> identifier = Identifier(IdentifierParameters(estimator='mean'))
    >>> print(round(identifier.estimate(window).mass, 9))
    0.2
    """

    def __init__(
        self,
        parameters: IdentifierParameters,
        known: LearnedKinds | None = None,
        failures: Failures = PRINTED,
    ) -> None:
        self._parameters = parameters
        self._failures = failures
        self._known = parameters.chosen
        self._estimator = METHODS[parameters.estimator](self._known)
        basis = parameters.basis
        # The learned state depends only on `known` and on the sequence of windows, so that a replay
        # of the same windows results in the same masses.
        self.learned = known if known is not None and known.basis == basis else LearnedKinds(basis)
        self._lesson: tuple[WeighWindow, LoadEstimate] | None = None

    @property
    def needs_denoised(self) -> bool:
        """Whether the estimator needs the denoised signal. All estimators need the raw signal."""
        return self._estimator.needs_denoised

    def estimate(self, window: WeighWindow) -> MassEstimate:
        """Return the mass of an item and its standard deviation, or the reasons for no mass."""
        return self.estimate_all([window])[0]

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[MassEstimate]:
        """Return the mass of the item in each window, or the reasons for no mass.

        The results are the same, to the last bit, as those of `estimate` for one window after the
        other.
        """
        refused = self._failures.each(self._refuse, self._failed, windows)
        accepted = [each for each, no in zip(windows, refused, strict=True) if no is None]
        loads: Iterator[LoadEstimate | MassEstimate] = iter(
            self._failures.together(self._estimator.estimate_all, self._failed, accepted)
        )
        found = [refusal or next(loads) for refusal in refused]
        return self._failures.each(self._weigh, self._failed, windows, found)

    def learn(self) -> None:
        """Learn from the last weighed window, if the stage has not learned from it yet.

        Without this call, the stage learns from the last window when it weighs the next one, which
        delays the next mass.
        """
        lesson, self._lesson = self._lesson, None
        if lesson is not None:
            self.learned = learn(self.learned, *lesson, self._parameters.learning)

    def forget(self) -> None:
        """Discard the learned state. The stage does not learn from the last weighed window."""
        self.learned, self._lesson = LearnedKinds(self.learned.basis), None

    def _failed(self, window: WeighWindow) -> MassEstimate:
        return self._record(window, (Reason.STAGE_FAILED.value,))

    def _weigh(self, window: WeighWindow, load: LoadEstimate | MassEstimate) -> MassEstimate:
        """Return the mass of the item in a window, or the reasons for no mass.

        `load` is the result of the estimator, or an estimate without a mass if the window was
        refused or the estimator raised an exception. If the parameter ``learn`` is True and the
        learned weights are trusted, these weights give the mass instead of the estimator.
        """
        if isinstance(load, MassEstimate):
            return load  # This is an estimate without a mass.
        estimate = self._estimate(window, load)
        if not estimate.reasons and not is_plausible(window):
            return self._record(window, (Reason.BAD_SIGNAL.value,), zero=estimate.zero)
        if not self._parameters.learn or estimate.reasons:
            return estimate
        self.learn()
        better = learned_load(self.learned, window, load)
        self._lesson = window, load
        if better is load:
            return estimate
        if not self._known.calibrated:
            # The learned weights are scaled to the loads that the untrained estimator found. So an
            # error of the gain of the untrained estimator is also an error of the learned weights.
            # Add the variance of the estimator to allow for an error of the gain.
            better = replace(better, variance=better.variance + load.variance)
        learned = self._estimate(window, better)
        return estimate if learned.reasons else learned

    def _refuse(self, window: WeighWindow) -> MassEstimate | None:
        """Return an estimate with reasons and no mass if a window is refused, otherwise None."""
        if window.reasons:
            return self._record(window, window.reasons)
        count = len(window.denoised)
        # Accept a window without a denoised signal if the estimator does not need it.
        complete = count == len(window.counts) or (count == 0 and not self.needs_denoised)
        if not is_consistent(window) or not complete:
            return self._record(window, (Reason.BAD_WINDOW.value,))
        known = self._known
        tolerance = self._parameters.speed_tolerance
        if known.calibrated and not known.is_trained(window.belt_speed, tolerance):
            return self._record(window, (Reason.SPEED_NOT_TRAINED.value,))
        return None

    def _record(self, window: WeighWindow, reasons: tuple[str, ...], **more: float) -> MassEstimate:
        return MassEstimate(
            window.item_id,
            window.t1,
            window.t2,
            window.t3,
            reasons,
            belt_speed=window.belt_speed,
            product_length=window.product_length,
            line_speed=window.line_speed,
            estimator=self._parameters.estimator,
            **more,
        )

    def _estimate(self, window: WeighWindow, load: LoadEstimate) -> MassEstimate:
        known, speed = self._known, window.belt_speed
        mass = known.at('gain', speed) * load.mass + known.at('offset', speed)
        variance = self._variance(window, load, mass)
        zero = (window.zero - window.zero_counts) / window.counts_per_kg
        stable = math.isnan(load.a1) or is_stable(load.a1, load.a2)
        limit = self._parameters.max_relative_std_dev * abs(mass)
        # If the mass or the variance is NaN, a comparison is false, so the item gets no mass.
        certain = variance >= 0 and math.sqrt(variance) <= limit < math.inf
        if not (stable and certain and is_in_window(load, window)):
            return self._record(window, (Reason.NO_CONVERGENCE.value,), zero=zero)
        if mass <= 0:
            return self._record(window, (Reason.NO_LOAD.value,), zero=zero)
        natural_frequency, damping_ratio = platform_poles(load.a1, load.a2, window.sample_rate)
        return self._record(
            window,
            (),
            zero=zero,
            mass=mass,
            std_dev=math.sqrt(variance),
            a1=load.a1,
            a2=load.a2,
            b1=load.b1,
            natural_frequency=natural_frequency,
            damping_ratio=damping_ratio,
        )

    def _variance(self, window: WeighWindow, load: LoadEstimate, mass: float) -> float:
        """Return the variance of a mass in kg^2.

        If the variance of the load was measured on items, it already includes the variance of the
        zero, and is multiplied by the squared gain. Without training, the variances of load and
        zero are added. After training, the variance of the training passes is used, which includes
        the variance of their zero. If the zero has a larger variance now than in the training, the
        difference is added. If the mass is beyond the masses of the training passes, the variance
        of the extrapolation is added.
        """
        known, speed = self._known, window.belt_speed
        zero_std_dev = window.zero_std_dev / window.counts_per_kg
        zero = zero_std_dev * zero_std_dev
        beyond = known.extrapolation_std_dev(mass, speed)
        if load.measured:
            gain = known.at('gain', speed)
            return gain * gain * load.variance + beyond * beyond
        if not known.calibrated:
            return load.variance + zero
        relative = known.at('relative_std_dev', speed) * mass
        trained, trained_zero = known.at('std_dev', speed), known.at('zero_std_dev', speed)
        worse = zero - trained_zero * trained_zero
        return trained * trained + relative * relative + max(worse, 0.0) + beyond * beyond
