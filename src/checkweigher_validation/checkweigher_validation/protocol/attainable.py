# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Attainable accuracy on a machine, estimated by ridge regression of the mass on the samples.

The machines are simulated with random parameters. The best accuracy on such a machine has no closed
form, because the covariance of the noise depends on the mass, the belt speed, and the times of the
edges, so it differs from pass to pass. A regression on more than a
thousand passes of the same machine needs no model. With as few passes as are used for tuning, the
regression is less accurate, and an estimator with a physical model can be better.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, WeighWindow
from checkweigher_dsp.denoising.window_batch import transit
from checkweigher_validation.accuracy.passes import KnownPass
from checkweigher_validation.tuning.calibration import index

_BEFORE = 0.2  # duration of the signal before t1 in s
_PENALTIES = np.logspace(-9, 1, 41)  # penalties of the ridge regression to choose from, in kg^2


def attainable_errors(
    learn: Sequence[KnownPass], check: Sequence[KnownPass]
) -> NDArray[np.float64]:
    """Fit a ridge regression to the passes `learn`, and return its errors on the passes `check`.

    The errors are estimated minus true masses, (n,) in kg. All passes must be without faults, and
    of the same machine and nominal speed. The regressors are the samples from 0.2 s before t1 to
    t3, interpolated at the same fractions of each pass, after subtraction of the zero. The penalty
    with the smallest overall index A in leave-one-out cross-validation is used.
    """
    span = min(_samples(each.window) for each in learn)
    signals, masses = _signals(learn, span), np.array([each.mass for each in learn])
    weights = _ridge(signals - signals.mean(axis=0), masses)
    found = (_signals(check, span) - signals.mean(axis=0)) @ weights + masses.mean()
    return np.asarray(found - np.array([each.mass for each in check]))


def _samples(window: WeighWindow) -> int:
    return int(transit(window) * window.sample_rate)


def _signals(passes: Sequence[KnownPass], span: int) -> NDArray[np.float64]:
    """Return the signal of each pass, (n, k) in kg, interpolated at k times.

    The times divide the duration from t1 to t3 into `span` equal steps, and continue with the
    same step for about 0.2 s before t1.
    """
    rows = []
    for each in passes:
        window = each.window
        first = ((window.t1 or 0) - window.stamp) / NANOSECONDS * window.sample_rate
        before = round(_BEFORE * window.sample_rate)
        at = first + np.arange(-before, span) * (_samples(window) / span)
        rows.append(np.interp(at, np.arange(window.window_end), window.force[: window.window_end]))
    return np.array(rows)


def _ridge(signals: NDArray[np.float64], masses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the weights, (k,), of a ridge regression of masses, (n,) in kg, on signals, (n, k).

    The signals must be centred. The masses are centred by this function.
    """
    targets = masses - masses.mean()
    left, values, right = np.linalg.svd(signals, full_matrices=False)
    along = left.T @ targets

    def held_out(penalty: float) -> float:
        shrinkage = values**2 / (values**2 + penalty)
        # Divide the residuals by 1 - leverage, which gives the leave-one-out errors.
        leverage = left**2 @ shrinkage + 1 / len(masses)
        return index((left @ (shrinkage * along) - targets) / (1 - leverage), masses)

    penalty = min(_PENALTIES, key=held_out)
    return np.asarray(right.T @ (values / (values**2 + penalty) * along))
