# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of Long et al. on their own machine: Table 3 of the paper, for comparison.

Their passes are not public. The simulated machine differs from theirs, so single figures agree only
by chance; magnitudes and the order of the algorithms can be compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.errors import Evaluation, overall_index, same


@dataclass(frozen=True, slots=True)
class PaperResult:
    """One cell of the table: standard deviation and mean error, kg."""

    std_dev: float
    mean_error: float

    @property
    def index(self) -> float:
        """Overall index A = |mu| + 3 sigma, kg."""
        return overall_index(self.mean_error, self.std_dev)


PAPER_SPEEDS = (0.5, 0.75, 1.0, 1.25, 1.5)  # m/s
PAPER_MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)  # kg
PAPER_ESTIMATORS = ('tvlpf', 'aid', 'aeksi', 'iswd_eksi')

# Belt speed in m/min, algorithm, and for each mass sigma and mu in g.
_TABLE_3 = """
30 tvlpf      0.031  0.048  0.040  0.033  0.033  0.003  0.036  0.021  0.040  0.012
30 aid        0.037  0.043  0.049  0.042  0.050  0.007  0.060  0.027  0.058  0.021
30 aeksi      0.027  0.040  0.043  0.032  0.037  0.002  0.049  0.014  0.039  0.020
30 iswd_eksi  0.029  0.039  0.038  0.033  0.028  0.013  0.041  0.002  0.033  0.024
45 tvlpf      0.065 -0.023  0.073 -0.001  0.088 -0.050  0.074  0.006  0.083  0.012
45 aid        0.057 -0.005  0.075 -0.022  0.102 -0.073  0.108  0.003  0.149 -0.055
45 aeksi      0.055 -0.016  0.077 -0.017  0.085 -0.033  0.090 -0.017  0.110  0.017
45 iswd_eksi  0.048  0.001  0.058 -0.001  0.056 -0.012  0.069 -0.014  0.078  0.001
60 tvlpf      0.084  0.020  0.111  0.064  0.119 -0.019  0.101 -0.012  0.166  0.050
60 aid        0.110 -0.008  0.108 -0.058  0.131  0.016  0.088  0.008  0.179  0.057
60 aeksi      0.083  0.043  0.101 -0.089  0.120 -0.002  0.095 -0.003  0.103  0.045
60 iswd_eksi  0.071 -0.006  0.075 -0.030  0.082  0.006  0.073  0.010  0.100 -0.003
75 tvlpf      0.187  0.025  0.220 -0.081  0.258  0.036  0.262 -0.011  0.271 -0.120
75 aid        0.162 -0.016  0.139 -0.056  0.136  0.009  0.156 -0.027  0.231 -0.127
75 aeksi      0.147 -0.011  0.132 -0.052  0.129  0.012  0.153 -0.044  0.205 -0.118
75 iswd_eksi  0.135 -0.013  0.126 -0.051  0.116  0.027  0.123 -0.029  0.198 -0.097
90 tvlpf      0.187  0.049  0.280  0.028  0.331 -0.060  0.363  0.094  0.407 -0.044
90 aid        0.169  0.023  0.201 -0.087  0.242 -0.029  0.240  0.017  0.264  0.027
90 aeksi      0.152 -0.003  0.198 -0.072  0.208 -0.001  0.223  0.005  0.250 -0.040
90 iswd_eksi  0.127  0.019  0.152 -0.053  0.179  0.019  0.157 -0.005  0.200  0.005
"""

# In kg, by speed, algorithm, mass, and sigma or mu.
_CELLS = np.reshape(
    [np.array(line.split()[2:], np.float64) / GRAMS for line in _TABLE_3.strip().split('\n')],
    (len(PAPER_SPEEDS), len(PAPER_ESTIMATORS), len(PAPER_MASSES), 2),
)


def paper_result(estimator: str, speed: float, mass: float) -> PaperResult | None:
    """Return the result of an algorithm at a speed in m/s and a mass in kg, or None."""
    row, column = _place(PAPER_SPEEDS, speed), _place(PAPER_MASSES, mass)
    if row is None or column is None or estimator not in PAPER_ESTIMATORS:
        return None
    return PaperResult(*_CELLS[row, PAPER_ESTIMATORS.index(estimator), column].tolist())


def paper_index(estimator: str, speed: float | None = None) -> float:
    """Return the mean A of an algorithm over the masses, in kg; NaN if the paper has none.

    At a speed in m/s, or averaged over the speeds if no speed is given.
    """
    speeds = PAPER_SPEEDS if speed is None else (speed,)
    found = [paper_result(estimator, one, mass) for one in speeds for mass in PAPER_MASSES]
    indices = [one.index for one in found if one is not None]
    return float(np.mean(indices)) if indices else math.nan


def has_paper_masses(evaluation: Evaluation) -> bool:
    """Return whether the masses are those of the paper, so that averages can be compared."""
    return _all_same(evaluation.masses, PAPER_MASSES)


def has_paper_conditions(evaluation: Evaluation) -> bool:
    """Return whether speeds and masses are those of the paper."""
    return has_paper_masses(evaluation) and _all_same(evaluation.speeds, PAPER_SPEEDS)


def comparable_index(evaluation: Evaluation, estimator: str, speed: float | None = None) -> float:
    """Return `paper_index` if the conditions of an evaluation are those of the paper, else NaN."""
    has_conditions = has_paper_conditions if speed is None else has_paper_masses
    return paper_index(estimator, speed) if has_conditions(evaluation) else math.nan


def _all_same(values: Sequence[float], others: Sequence[float]) -> bool:
    return len(values) == len(others) and all(map(same, values, others))


def _place(values: tuple[float, ...], value: float) -> int | None:
    return next((place for place, one in enumerate(values) if same(one, value)), None)
