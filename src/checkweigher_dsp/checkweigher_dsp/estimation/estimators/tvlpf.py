"""The time-varying low-pass filter as an estimator."""

from dataclasses import dataclass
from typing import ClassVar

from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    Plateau,
    raw_plateau,
    rough_variance,
)
from checkweigher_dsp.estimation.estimators.lowpass import time_varying_lowpass
from checkweigher_dsp.parameters import parameter
from checkweigher_dsp.records import WeighWindow


@dataclass(frozen=True)
class TvlpfParameters(EstimatorParameters):
    """The schedule of the cut-off; times are relative to the window, so that they scale with it."""

    node: ClassVar[str] = 'identifier.tvlpf'

    sections: tuple[float, ...] = parameter(
        (2.0,), 'first-order sections, rounded', minimum=1, maximum=8
    )
    initial_cutoff: tuple[float, ...] = parameter(
        (50.0,), 'cut-off at t2', unit='Hz', minimum=0, maximum=1e5
    )
    final_cutoff: tuple[float, ...] = parameter(
        (3.0,), 'what the cut-off falls to', unit='Hz', minimum=0, maximum=1e5
    )
    half_life: tuple[float, ...] = parameter(
        (0.1,), 'in which the cut-off comes half of the way down, share of the window',
        minimum=1e-4, maximum=1e3,
    )  # fmt: skip


class Tvlpf(Estimator):
    """Estimate by the last output of a low-pass filter whose cut-off falls (reconstruction)."""

    parameters: TvlpfParameters

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the output of the filter at t3."""
        samples, known, speed = raw_plateau(window), self.parameters, window.belt_speed
        mass = time_varying_lowpass(
            samples,
            max(1, round(known.at('sections', speed))),
            known.at('initial_cutoff', speed),
            known.at('final_cutoff', speed),
            decay_of(known.at('half_life', speed), len(samples)),
            window.sample_rate,
        )
        return Plateau(float(mass), rough_variance(samples))


def decay_of(half_life: float, count: int) -> float:
    """Return r of a schedule for a half life that is a share of a window of `count` samples."""
    return float(0.5 ** (1 / (half_life * count)))
