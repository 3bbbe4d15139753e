# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""FIR model estimator: a weighted sum of the samples with weights learned from known masses.

This is a reconstruction from the abstract of Niedzwiecki, Meller, Pietrzak, System identification
based approach to dynamic weighing revisited, Mechanical Systems and Signal Processing 80 (2016),
and related papers. The weights are a smooth curve over the relative position in the window. The
values of the curve at a fixed number of knots are learned. So the curve also applies to windows of
other lengths and speeds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
import math
from typing import ClassVar

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.estimation.estimators.base import (
    Average,
    Axis,
    EstimatorParameters,
    PlotStyle,
    raw_samples,
)
from checkweigher_dsp.signal import Array

_KNOTS = 24  # default number of knots.
# The default curve is a Hann window.
_HANN = tuple(
    round(math.sin(math.pi * (knot + 1) / (_KNOTS + 1)) ** 2, 6) for knot in range(_KNOTS)
)


@dataclass(frozen=True)
class FirModelParameters(EstimatorParameters):
    """Parameters of the FIR model: the curve of the weights over the window."""

    node: ClassVar[str] = 'identifier.fir_model'

    knots: int = parameter(_KNOTS, 'number of knots of the curve', minimum=2, maximum=512)
    weights: tuple[float, ...] = parameter(
        _HANN, 'values of the curve: `knots` values for each speed', minimum=-1e6, maximum=1e6
    )

    def fits(self, name: str, count: int) -> bool:
        """Return whether the list `name` may have `count` values."""
        return count == len(self.speeds) * (self.knots if name == 'weights' else 1)


class FirModel(Average):
    """Weighted sum of the samples with learned weights (reconstruction).

    Examples
    --------
    >>> print(round(FirModel(FirModelParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = FirModelParameters()
    look = PlotStyle('FIR model', 'h', '#b4569a', '#db8cc4')
    axes = (Axis('ridge', 1e-6, 10.0, 1e-3, logarithmic=True),)
    folds = 5
    fewest = 2

    def average(self, samples: Array, window: WeighWindow) -> float:
        """Return the sum of the samples, weighted by the curve for the belt speed.

        The curve is interpolated between the training speeds. The result is NaN if the weights
        cannot be scaled to a sum of 1.
        """
        curve = self.parameters.row_at('weights', window.belt_speed)
        try:
            return float(np.add.reduce(samples * fir_weights(curve, len(samples))))
        except ValueError:  # The sum of the weights is 0 or not finite.
            return math.nan

    @classmethod
    def learn(
        cls,
        known: FirModelParameters,
        windows: Sequence[WeighWindow],
        masses: Array,
        values: Mapping[str, float],
    ) -> dict[str, tuple[float, ...]]:
        """Return the weights that `fit_fir` learns with the penalty ``ridge`` in `values`."""
        samples = [raw_samples(window) for window in windows]
        return {'weights': tuple(fit_fir(samples, masses, known.knots, values['ridge']).tolist())}


def fir_weights(knots: Array, count: int) -> Array:
    """Return the weights of `count` samples, with sum 1.

    The weights are interpolated linearly between the values `knots`, (k,), which are equally spaced
    from the first sample to the last sample.

    Raises
    ------
    ValueError
        If the weights cannot be scaled to a sum of 1.

    Examples
    --------
    >>> fir_weights(np.array([0.0, 1.0, 0.0]), 5).tolist()
    [0.0, 0.25, 0.5, 0.25, 0.0]
    """
    weights = _basis(count, len(knots)) @ knots
    total = float(weights.sum())
    if not (np.isfinite(total) and abs(total) > _LEAST_SUM * float(np.abs(weights).sum())):
        raise ValueError(f'the sum of the weights at {len(knots)} knots is 0 or not finite')
    return weights / total


_LEAST_SUM = 1e-9


def fit_fir(samples: Sequence[Array] | Array, masses: Array, count: int, ridge: float) -> Array:
    r"""Learn smooth weights with a small error on training passes, at unity gain.

    A value of 1 at knot j adds z_j to the weighted sum of a window, and c_j to the weighted sum of
    a constant load of 1. M is the true mass, and :math:`e_j = z_j - M c_j` is the error. The part
    of the error that depends linearly on M is subtracted by linear regression, because gain and
    offset later correct it. The remaining error has the covariance R. The values w of the knots
    minimise

    .. math:: w' R w + \lambda \bar R \, |\Delta^2 w|^2 \quad\text{with}\quad c' w = 1,

    where :math:`\bar R` is the mean of the diagonal of R. The unity gain is a constraint, so passes
    of a single mass are sufficient. With several masses, gain and offset can be fitted to the
    estimates afterwards.

    Parameters
    ----------
    samples : sequence of ndarray, (n,) float64, or ndarray, (passes, n) float64
        At least two windows from t2 to t3 without the zero. Their lengths may differ.
    masses : ndarray, (passes,) float64
        True masses in the unit of `samples`.
    count : int
        Number of knots k, at least 2. To resolve an oscillation at f Hz, k must be at least 2 f
        times the duration of the window.
    ridge : float
        Smoothness lambda, not negative. A larger value makes the weights smoother; in the limit
        they are a straight line.

    Returns
    -------
    ndarray, (k,) float64
        Values at the knots, for `fir_weights`.
    """
    bases = [_basis(len(window), count) for window in samples]
    features = np.stack(
        [window @ basis / len(basis) for window, basis in zip(samples, bases, strict=True)]
    )
    loads = np.stack([basis.mean(axis=0) for basis in bases])
    unit = loads.mean(axis=0)
    error = features - masses[:, None] * loads
    # The mean is subtracted from the masses, so that passes of a single mass have only an offset.
    regressors = np.stack([np.ones(len(masses)), masses - masses.mean()], axis=1)
    error -= regressors @ np.linalg.lstsq(regressors, error, rcond=None)[0]
    covariance = error.T @ error / len(error)
    scale = float(np.trace(covariance)) / count or 1.0
    curvature = np.diff(np.eye(count), 2, axis=0)
    penalty = ridge * curvature.T @ curvature + _LEAST_RIDGE * np.eye(count)
    knots = np.linalg.solve(covariance + scale * penalty, unit)
    return np.asarray(knots / (unit @ knots))


# This ridge keeps the regression solvable if there are fewer passes than knots.
_LEAST_RIDGE = 1e-9


@lru_cache(maxsize=64)
def _basis(count: int, knots: int) -> Array:
    """Return the weight of each knot in the interpolated curve at each sample, (count, knots)."""
    position = np.linspace(0, knots - 1, count) if count > 1 else np.full(1, (knots - 1) / 2)
    basis = np.maximum(0, 1 - abs(position[:, None] - np.arange(knots)))
    basis.flags.writeable = False
    return basis
