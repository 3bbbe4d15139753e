# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Control chart of means and standard deviations of subgroups, with the rules of ISO 7870-2.

The rules of ISO 7870-2:2013, 8.2, are quoted from memory, and were not compared with the standard.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

# Number of items in a subgroup.
SUBGROUP = 5
# Number of items in the reference period, which sets the limits.
REFERENCE = 20 * SUBGROUP
# Number of successive means that violate a rule if all of them lie on one side of the centre line,
# or if they increase or decrease from each mean to the next.
_RUN = 7


@dataclass(frozen=True, slots=True)
class ControlChart:
    """Means and standard deviations of subgroups, with centre lines and limits, in kg."""

    means: NDArray[np.float64]  # mean of each subgroup, (groups,)
    std_devs: NDArray[np.float64]  # standard deviation of each subgroup, (groups,)
    centre: float  # centre line of the means
    lower: float  # lower limit of the means
    upper: float  # upper limit of the means.
    # Centre line of the standard deviations.
    spread: float
    # Upper limit of the standard deviations.
    spread_upper: float
    # Rule that each mean violates, or '' if the mean violates no rule or the same rule as the
    # previous mean.
    marks: tuple[str, ...]


def control_chart(
    masses: Sequence[float], reference: Sequence[float] | None = None
) -> ControlChart | None:
    """Return the control chart of masses in kg, which are in chronological order.

    Successive masses form subgroups of `SUBGROUP` masses. Masses after the last full subgroup are
    ignored. Returns None if `masses` or `reference` contains fewer than two subgroups. The limits
    are computed from the masses of the `reference` period, by default from all masses. With a
    reference period, the limits do not follow a process that drifts. The limits of the means are
    their centre line minus and plus three times the standard deviation of a subgroup mean. The
    upper limit of the subgroup standard deviations is their centre line plus three times the
    standard deviation of a subgroup standard deviation. These limits are computed from the mean of
    the subgroup standard deviations, with the factors A3 and B4 of ISO 7870-2, table 2.

    Examples
    --------
    >>> chart = control_chart([0.1, 0.102, 0.098, 0.1, 0.1] * 3)
    >>> print(len(chart.means), round(chart.centre, 6), chart.marks)
    3 0.1 ('', '', '')
    """
    groups = _subgroups(masses)
    of_reference = groups if reference is None else _subgroups(reference)
    if min(len(groups), len(of_reference)) < 2:
        return None
    means, std_devs = groups.mean(axis=1), groups.std(axis=1, ddof=1)
    centre = float(of_reference.mean())
    spread = float(of_reference.std(axis=1, ddof=1).mean())
    # Expected sample standard deviation of SUBGROUP values from the standard normal distribution.
    c4 = math.sqrt(2 / (SUBGROUP - 1)) * math.gamma(SUBGROUP / 2) / math.gamma((SUBGROUP - 1) / 2)
    reach = 3 * spread / c4 / math.sqrt(SUBGROUP)
    lower, upper = centre - reach, centre + reach
    spread_upper = spread * (1 + 3 * math.sqrt(1 - c4 * c4) / c4)
    marks = _marks(means, centre, lower, upper)
    return ControlChart(means, std_devs, centre, lower, upper, spread, spread_upper, marks)


def _subgroups(masses: Sequence[float]) -> NDArray[np.float64]:
    count = len(masses) // SUBGROUP
    return np.reshape(masses[: count * SUBGROUP], (count, SUBGROUP))


def begun(rules: Iterable[str]) -> tuple[str, ...]:
    """Return the rules, with '' instead of each rule that equals the previous rule."""
    found = [*rules]
    return tuple(
        '' if rule == before else rule for before, rule in zip(['', *found], found, strict=False)
    )


def _marks(
    means: NDArray[np.float64], centre: float, lower: float, upper: float
) -> tuple[str, ...]:
    side = _sums_of_last(_RUN, np.sign(means - centre))
    step = _sums_of_last(_RUN - 1, np.sign(np.diff(means, prepend=means[0])))
    rules = {
        'beyond the limits': (means < lower) | (means > upper),
        f'{_RUN} on one side': abs(side) == _RUN,
        f'{_RUN} rising': step == _RUN - 1,
        f'{_RUN} falling': step == 1 - _RUN,
    }
    return begun(np.select([*rules.values()], [*rules], '').tolist())


def _sums_of_last(count: int, signs: NDArray[np.float64]) -> NDArray[Any]:
    return np.convolve(signs, np.ones(count))[: len(signs)]
