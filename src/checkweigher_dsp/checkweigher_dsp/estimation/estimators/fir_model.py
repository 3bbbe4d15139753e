"""The FIR model as an estimator."""

from dataclasses import dataclass
import math
from typing import ClassVar

import numpy as np

from checkweigher_dsp.estimation.estimators.base import (
    Estimator,
    EstimatorParameters,
    Plateau,
    raw_plateau,
    rough_variance,
)
from checkweigher_dsp.estimation.estimators.fir_weights import fir_estimate
from checkweigher_dsp.parameters import parameter
from checkweigher_dsp.records import WeighWindow

# Until it is trained, a Hann window: sin^2 at the knots.
_KNOTS = 24
_HANN = tuple(
    round(math.sin(math.pi * (knot + 1) / (_KNOTS + 1)) ** 2, 6) for knot in range(_KNOTS)
)


@dataclass(frozen=True)
class FirModelParameters(EstimatorParameters):
    """The curve of the weights over the window."""

    node: ClassVar[str] = 'identifier.fir_model'

    knots: int = parameter(_KNOTS, 'of the curve', minimum=2, maximum=512)
    weights: tuple[float, ...] = parameter(
        _HANN, 'values of the curve: `knots` values for each speed', minimum=-1e6, maximum=1e6
    )

    def fits(self, name: str, count: int) -> bool:
        """Tell whether the list `name` may have `count` values."""
        return count == len(self.speeds) * (self.knots if name == 'weights' else 1)


class FirModel(Estimator):
    """Estimate by a weighted sum of the samples, the weights learned (reconstruction)."""

    parameters: FirModelParameters

    def estimate(self, window: WeighWindow) -> Plateau:
        """Return the weighted sum of a window."""
        samples, known = raw_plateau(window), self.parameters
        curves = np.reshape(known.weights, (len(known.speeds), known.knots))
        curve = [np.interp(window.belt_speed, known.speeds, knot) for knot in curves.T]
        try:
            mass = float(fir_estimate(samples, np.array(curve)))
        except ValueError:  # weights whose sum is 0
            return Plateau(math.nan)
        return Plateau(mass, rough_variance(samples))
