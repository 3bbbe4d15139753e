"""Averages of a signal that vibrates."""

import numpy as np
from numpy.typing import NDArray


def hann_mean(samples: NDArray[np.float64]) -> float:
    """Return the mean of samples weighted by a Hann window without its two zeros.

    Of a line that goes through two or more periods it leaves little, wherever in a period the
    samples begin and end; a plain mean does so only for whole periods.

    Parameters
    ----------
    samples : ndarray, (n,) float64
        At least one.
    """
    weights = np.hanning(len(samples) + 2)[1:-1]
    return float(weights @ samples / weights.sum())
