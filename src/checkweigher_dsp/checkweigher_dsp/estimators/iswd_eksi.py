"""ISWD-EKSI: extended Kalman identification of the denoised window."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import ClassVar

import numpy as np

from checkweigher_dsp.denoising import denoised_pass
from checkweigher_dsp.estimators.base import Estimator, EstimatorParameters, Plateau, raw_plateau
from checkweigher_dsp.identification import WindowNoise, identify_window
from checkweigher_dsp.parameters import parameter
from checkweigher_dsp.records import WeighWindow

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
        """Return what `estimate` makes of each window; those of equal length are done at once."""
        passes = [denoised_pass(window) for window in windows]
        lengths: dict[int, list[int]] = {}
        for number, (denoised, _) in enumerate(passes):
            lengths.setdefault(len(denoised), []).append(number)
        result: list[Plateau] = [Plateau(math.nan)] * len(windows)
        for numbers in lengths.values():
            if len(numbers) < _FEW:
                for number in numbers:
                    result[number] = self.estimate(windows[number])
                continue
            rises = [self._noise(windows[number].belt_speed).rise for number in numbers]
            found = identify_window(
                np.array([passes[number][0] for number in numbers]),
                np.array([_removed_variance(windows[number]) for number in numbers]),
                np.array([passes[number][1] for number in numbers]),
                replace(self._noise(windows[numbers[0]].belt_speed), rise=np.array(rises)),
            )
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


# Fewer windows than these are identified faster one by one: arithmetic on arrays costs by the call.
_FEW = 32


def _removed_variance(window: WeighWindow) -> float:
    """Return the variance that denoising took out between t2 and t3, kg^2."""
    plateau = window.denoised[window.window_begin : window.window_end]
    return float(np.var(raw_plateau(window) - plateau))
