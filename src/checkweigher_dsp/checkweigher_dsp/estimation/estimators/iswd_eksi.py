"""ISWD-EKSI: extended Kalman identification of the denoised window."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import ClassVar

import numpy as np

from checkweigher_dsp.denoising.denoiser import denoised_pass
from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    Plateau,
    raw_plateau,
)
from checkweigher_dsp.parameters import parameter
from checkweigher_dsp.records import WeighWindow
from checkweigher_dsp.signal.averages import variance
from checkweigher_dsp.signal.window_identification import (
    FEW,
    WindowGroup,
    WindowNoise,
    identify_groups,
    identify_window,
)

_NOISE = WindowNoise()


@dataclass(frozen=True)
class IswdEksiParameters(EstimatorParameters):
    """The noise that the filter reckons with."""

    node: ClassVar[str] = 'identifier.iswd_eksi'

    measurement_noise: float = parameter(
        _NOISE.measurement, 'R as a share of the variance that denoising removed',
        minimum=1e-9, maximum=1e9,
    )  # fmt: skip
    process_noise: float = parameter(_NOISE.process, 'Q as a multiple of R', minimum=0, maximum=1e9)
    initial_variance: float = parameter(
        _NOISE.initial, 'P0 of x and b1, the signal being normalised to 1',
        minimum=1e-9, maximum=1e9,
    )  # fmt: skip
    coefficient_variance: float = parameter(
        _NOISE.coefficients, 'P0 of a1 and a2; 1 with the other 1 is P0 = I',
        minimum=0, maximum=1e9,
    )  # fmt: skip
    rise_noise: tuple[float, ...] = parameter(
        (_NOISE.rise,), 'R while the load rises, as a multiple of R: 1e9 begins at t2',
        minimum=1, maximum=1e9,
    )  # fmt: skip


class IswdEksi(Estimator):
    """Estimate by extended Kalman identification of the denoised pass, from t1 or t2 to t3."""

    parameters: IswdEksiParameters
    needs_denoised: ClassVar[bool] = True

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the steady state of the identified platform."""
        denoised, share = denoised_pass(window)
        found = identify_window(
            denoised, _removed_variance(window), share, self._noise(window.belt_speed)
        )
        return Plateau(found.gain, found.variance, found.a1, found.a2, found.b1)

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[Plateau]:
        """Return what `estimate` makes of each window, all at once if they are not too few."""
        if len(windows) < FEW:
            return [self.estimate(window) for window in windows]
        passes = [denoised_pass(window) for window in windows]
        lengths: dict[int, list[int]] = {}
        for number, (denoised, _) in enumerate(passes):
            lengths.setdefault(len(denoised), []).append(number)
        groups = [
            WindowGroup(
                np.array([passes[number][0] for number in numbers]),
                np.array([_removed_variance(windows[number]) for number in numbers]),
                np.array([passes[number][1] for number in numbers]),
                np.array([self._noise(windows[number].belt_speed).rise for number in numbers]),
            )
            for numbers in lengths.values()
        ]
        result: list[Plateau] = [Plateau(math.nan)] * len(windows)
        all_found = identify_groups(groups, self._noise(windows[0].belt_speed))
        for numbers, found in zip(lengths.values(), all_found, strict=True):
            columns = (found.gain, found.variance, found.a1, found.a2, found.b1)
            rows = zip(*(column.tolist() for column in columns), strict=True)
            for number, row in zip(numbers, rows, strict=True):
                result[number] = Plateau(*row)
        return result

    def _noise(self, belt_speed: float) -> WindowNoise:
        known = self.parameters
        return WindowNoise(
            known.measurement_noise, known.process_noise, known.initial_variance,
            known.coefficient_variance, known.at('rise_noise', belt_speed),
        )  # fmt: skip


def _removed_variance(window: WeighWindow) -> float:
    """Return the variance that denoising took out between t2 and t3, kg^2."""
    plateau = window.denoised[window.window_begin : window.window_end]
    return variance(raw_plateau(window) - plateau)
