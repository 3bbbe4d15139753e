"""ISWD-EKSI: extended Kalman identification of the denoised window."""

from dataclasses import dataclass
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

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the steady state of the identified platform."""
        known = self.parameters
        denoised, share = denoised_pass(window)
        plateau = window.denoised[window.window_begin : window.window_end]
        found = identify_window(
            denoised,
            float(np.var(raw_plateau(window) - plateau)),
            share,
            WindowNoise(
                known.measurement_noise, known.process_noise, known.initial_variance,
                known.coefficient_variance, known.at('rise_noise', window.belt_speed),
            ),
        )  # fmt: skip
        return Plateau(found.gain, found.variance, found.a1, found.a2, found.b1)
