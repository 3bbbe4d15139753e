"""From a denoised weigh window to a mass: the estimators, selectable by name."""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising import is_consistent
from checkweigher_dsp.identification import Noise, identify, is_stable, platform_poles
from checkweigher_dsp.parameters import Parameters, parameter
from checkweigher_dsp.records import MassEstimate, Reason, WeighWindow


@dataclass(frozen=True, slots=True)
class Plateau:
    """What an estimator makes of a window: the load in kg and its variance in kg^2.

    ``a1``, ``a2`` and ``b1`` (kg) only from those that identify the platform.
    """

    mass: float
    variance: float
    a1: float = math.nan
    a2: float = math.nan
    b1: float = math.nan


def estimate_by_iswd_eksi(window: WeighWindow, parameters: 'IdentifierParameters') -> Plateau:
    """Estimate by extended Kalman identification of the denoised window (ISWD-EKSI).

    The signal is normalised by its mean, and the noise that the filter works with is a share of
    what denoising took out of this very window: both without a unit.
    """
    denoised = window.denoised[window.window_begin : window.window_end]
    scale = float(np.mean(denoised))
    if not (math.isfinite(scale) and scale != 0):
        return Plateau(math.nan, math.nan)
    # Products and quotients of floats become inf or 0 beyond their range, powers raise.
    removed = float(np.var(_raw_plateau(window) - denoised)) / scale / scale
    noise = max(parameters.measurement_noise * removed, _LEAST_NOISE)
    result = identify(
        (denoised / scale).tolist(),
        Noise(parameters.process_noise * noise, noise, parameters.initial_variance),
    )
    return Plateau(
        scale * result.gain,
        scale * scale * result.variance,
        result.a1,
        result.a2,
        scale * result.b1,
    )


# Relative variance that even a noise-free signal is credited with: the filter stays regular.
_LEAST_NOISE = 1e-12

# A further estimator is one function and one line here.
ESTIMATORS: dict[str, Callable[[WeighWindow, 'IdentifierParameters'], Plateau]] = {
    'iswd_eksi': estimate_by_iswd_eksi,
}


@dataclass(frozen=True)
class IdentifierParameters(Parameters):
    """Which estimator makes the mass, and the noise that it reckons with."""

    node: ClassVar[str] = 'identifier'

    estimator: str = parameter('iswd_eksi', 'method that makes the mass', choices=tuple(ESTIMATORS))
    measurement_noise: float = parameter(
        0.25, 'R as a share of the variance that denoising removed', minimum=1e-9, maximum=1e9
    )
    process_noise: float = parameter(0.01, 'Q as a multiple of R', minimum=0, maximum=1e9)
    initial_variance: float = parameter(
        1.0, 'P0 of each state, the signal being normalised to 1', minimum=1e-9, maximum=1e9
    )
    max_relative_std_dev: float = parameter(
        0.25, 'NoConvergence above this standard deviation, relative to the mass',
        minimum=0, maximum=1e9,
    )  # fmt: skip


class Identifier:
    """Make a mass estimate of each denoised window."""

    def __init__(self, parameters: IdentifierParameters) -> None:
        self._parameters = parameters
        self._estimate = ESTIMATORS[parameters.estimator]

    def estimate(self, window: WeighWindow) -> MassEstimate:
        """Return the mass in a window with its uncertainty, or the reasons why there is none."""
        unknown = MassEstimate(
            window.item_id, window.t1, window.t2, window.t3, window.reasons,
            belt_speed=window.belt_speed, product_length=window.product_length,
            line_speed=window.line_speed,
            estimator=self._parameters.estimator,
        )  # fmt: skip
        if window.reasons:
            return unknown
        if not is_consistent(window) or len(window.denoised) != len(window.counts):
            return replace(unknown, reasons=(Reason.BAD_WINDOW.value,))
        plateau = self._estimate(window, self._parameters)
        zero_std_dev = window.zero_std_dev / window.counts_per_kg
        variance = plateau.variance + zero_std_dev * zero_std_dev
        estimate = replace(unknown, zero=(window.zero - window.zero_counts) / window.counts_per_kg)
        if not self._has_converged(plateau, variance):
            return replace(estimate, reasons=(Reason.NO_CONVERGENCE.value,))
        if plateau.mass <= 0:
            return replace(estimate, reasons=(Reason.NO_LOAD.value,))
        natural_frequency, damping_ratio = platform_poles(
            plateau.a1, plateau.a2, window.sample_rate
        )
        return replace(
            estimate,
            mass=plateau.mass,
            std_dev=math.sqrt(variance),
            a1=plateau.a1,
            a2=plateau.a2,
            b1=plateau.b1,
            natural_frequency=natural_frequency,
            damping_ratio=damping_ratio,
        )

    def _has_converged(self, plateau: Plateau, variance: float) -> bool:
        if not (math.isfinite(plateau.mass) and math.isfinite(variance) and variance >= 0):
            return False
        if not math.isnan(plateau.a1) and not is_stable(plateau.a1, plateau.a2):
            return False
        return math.sqrt(variance) <= self._parameters.max_relative_std_dev * abs(plateau.mass)


def _raw_plateau(window: WeighWindow) -> NDArray[np.float64]:
    """Return the raw signal from t2 to t3 in kg."""
    return window.force[window.window_begin : window.window_end]
