# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results in Table 3 of the paper (Long et al.), which were obtained on a real machine.

The simulated machine differs from the machine of the paper, whose signals are not public. Therefore
only orders of magnitude and the ranking of the estimators can be compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.errors import Evaluation, overall_index, same


@dataclass(frozen=True, slots=True)
class PaperResult:
    """Result of one estimator at one speed and mass in the table."""

    std_dev: float  # standard deviation sigma of the errors in kg
    mean_error: float  # mean error mu in kg

    @property
    def index(self) -> float:
        """Overall index ``A = |mu| + 3 sigma`` in kg."""
        return overall_index(self.mean_error, self.std_dev)


PAPER_SPEEDS = (0.5, 0.75, 1.0, 1.25, 1.5)  # belt speeds in the table, in m/s
PAPER_MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)  # masses in the table, in kg
PAPER_ESTIMATORS = ('tvlpf', 'aid', 'aeksi', 'iswd_eksi')

# Values in kg by speed, estimator, mass, and statistic (sigma, mu).
_CELLS = np.reshape(
    np.loadtxt(Path(__file__).with_name('paper_table.txt'), usecols=range(2, 12)) / GRAMS,
    (len(PAPER_SPEEDS), len(PAPER_ESTIMATORS), len(PAPER_MASSES), 2),
)


def paper_result(estimator: str, speed: float, mass: float) -> PaperResult | None:
    """Return the result at a speed in m/s and a mass in kg, or None if the paper has none."""
    row, column = _place(PAPER_SPEEDS, speed), _place(PAPER_MASSES, mass)
    if row is None or column is None or estimator not in PAPER_ESTIMATORS:
        return None
    return PaperResult(*_CELLS[row, PAPER_ESTIMATORS.index(estimator), column].tolist())


def paper_index(estimator: str, speed: float | None = None) -> float:
    """Return the mean A of an estimator in kg, or NaN if the paper has no results.

    A is averaged over the masses at a speed in m/s or, if `speed` is None, also over the speeds.
    """
    speeds = PAPER_SPEEDS if speed is None else (speed,)
    found = [paper_result(estimator, one, mass) for one in speeds for mass in PAPER_MASSES]
    indices = [one.index for one in found if one is not None]
    return float(np.mean(indices)) if indices else math.nan


def has_paper_masses(evaluation: Evaluation) -> bool:
    """Return whether the masses of an evaluation are those of the paper, except for rounding."""
    return _all_same(evaluation.masses, PAPER_MASSES)


def has_paper_conditions(evaluation: Evaluation) -> bool:
    """Return whether the speeds and masses of an evaluation are those of the paper."""
    return has_paper_masses(evaluation) and _all_same(evaluation.speeds, PAPER_SPEEDS)


def comparable_index(evaluation: Evaluation, estimator: str, speed: float | None = None) -> float:
    """Return `paper_index`, or NaN if an evaluation has other masses or speeds than the paper.

    The masses are always compared with the masses of the paper. The speeds are compared only if
    `speed` is None.
    """
    has_conditions = has_paper_conditions if speed is None else has_paper_masses
    return paper_index(estimator, speed) if has_conditions(evaluation) else math.nan


def _all_same(values: Sequence[float], others: Sequence[float]) -> bool:
    return len(values) == len(others) and all(map(same, values, others))


def _place(values: tuple[float, ...], value: float) -> int | None:
    return next((place for place, one in enumerate(values) if same(one, value)), None)
