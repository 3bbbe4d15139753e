"""AID and AEKSI: identification behind a prefilter that is made from the very window."""

from dataclasses import dataclass
import math
from typing import ClassVar

from checkweigher_dsp.estimation.estimators.adaptive_identification import (
    LEAST_SAMPLES,
    AdaptiveIdentification,
    AdaptiveSettings,
    FilterNoise,
    identify_adaptive,
    identify_adaptive_by_ekf,
)
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    Plateau,
    raw_plateau,
)
from checkweigher_dsp.parameters import parameter
from checkweigher_dsp.records import WeighWindow


@dataclass(frozen=True)
class AdaptiveParameters(EstimatorParameters):
    """The prefilter."""

    iterations: tuple[float, ...] = parameter(
        (2.0,), 'times that the platform is identified, rounded; 1 is without a prefilter',
        minimum=1, maximum=20,
    )  # fmt: skip
    max_order: tuple[float, ...] = parameter(
        (2.0,), 'highest order of the prefilter, rounded', minimum=0, maximum=100
    )
    lowpass_cutoff: tuple[float, ...] = parameter(
        (480.0,), 'of the fixed low-pass; none from 0.36 times the sample rate on', unit='Hz',
        minimum=1, maximum=1e6,
    )  # fmt: skip

    def settings(self, speed: float) -> AdaptiveSettings:
        """Return the settings at a belt speed in m/s."""
        return AdaptiveSettings(
            max(1, round(self.at('iterations', speed))),
            round(self.at('max_order', speed)),
            self.at('lowpass_cutoff', speed),
        )


@dataclass(frozen=True)
class AidParameters(AdaptiveParameters):
    """The prefilter of AID."""

    node: ClassVar[str] = 'identifier.aid'


@dataclass(frozen=True)
class AeksiParameters(AdaptiveParameters):
    """The prefilter of AEKSI and the noise that its filter reckons with."""

    node: ClassVar[str] = 'identifier.aeksi'

    measurement_noise: tuple[float, ...] = parameter(
        (1.0,), 'R as a multiple of the variance of the least-squares residual',
        minimum=1e-9, maximum=1e9,
    )  # fmt: skip
    process_noise: tuple[float, ...] = parameter(
        (0.1,), 'Q as a multiple of R', minimum=0, maximum=1e9
    )
    coefficient_variance: tuple[float, ...] = parameter(
        (1.0,), 'P0 of a1 and a2', minimum=1e-12, maximum=1e9
    )


class Aid(Estimator):
    """Estimate by adaptively prefiltered least-squares identification (reconstruction)."""

    parameters: AidParameters

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the steady state of the identified platform."""
        samples = raw_plateau(window)
        if len(samples) < LEAST_SAMPLES:
            return Plateau(math.nan)
        return _plateau(
            identify_adaptive(
                samples, self.parameters.settings(window.belt_speed), window.sample_rate
            )
        )


class Aeksi(Estimator):
    """Estimate by adaptively prefiltered extended Kalman identification (reconstruction)."""

    parameters: AeksiParameters

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the steady state of the identified platform."""
        samples, known, speed = raw_plateau(window), self.parameters, window.belt_speed
        if len(samples) < LEAST_SAMPLES:
            return Plateau(math.nan)
        noise = FilterNoise(
            known.at('measurement_noise', speed),
            known.at('process_noise', speed),
            known.at('coefficient_variance', speed),
        )
        return _plateau(
            identify_adaptive_by_ekf(samples, known.settings(speed), noise, window.sample_rate)
        )


def _plateau(found: AdaptiveIdentification) -> Plateau:
    if not found.stable:
        return Plateau(float(found.mass), float(found.variance))
    return Plateau(
        float(found.mass), float(found.variance), float(found.a1), float(found.a2), float(found.b1)
    )
