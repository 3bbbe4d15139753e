# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items of a lane or a recorded shift over time, and their means in intervals."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS, NANOSECONDS, Decision, Verdict
from checkweigher_web.languages.language import Mass, Text

HOUR = 3600 * NANOSECONDS
Change = tuple[int, Text]  # stamp in ns, and description of the change


@dataclass(frozen=True, slots=True)
class History:
    """Items whose time is known, with the noise of the belt and the changes of settings.

    The items are in the order of their verdicts.

    Attributes
    ----------
    stamps : array of shape (n,)
        Times of the items in ns.
    decisions : array of shape (n,)
        Decisions on the items, as values of `Decision`.
    masses, zeros : array of shape (n,)
        Gross masses in g, and zeros in g relative to the zero of calibration. Unknown values are
        NaN.
    noise : array of shape (m, 2)
        Times in ns in the first column, and standard deviations of the signal of the empty belt in
        g in the second column.
    changes : tuple of (int, Text)
        Changes of product, batch, limits and zero, and actions of users, in order of time.
    """

    stamps: NDArray[np.int64]
    decisions: NDArray[np.int64]
    masses: NDArray[np.float64]
    zeros: NDArray[np.float64]
    noise: NDArray[np.float64]
    changes: tuple[Change, ...]


def history_of(
    items: Iterable[tuple[Verdict, float]],
    noise: Iterable[tuple[int, float]] = (),
    changes: Iterable[Change] = (),
) -> History:
    """Return the history of items, each of which is given as its verdict and its zero in kg.

    An unknown zero is NaN. Items whose time is unknown are left out. `noise` contains times in ns
    and standard deviations of the signal of the empty belt in g. `changes` contains the changes
    that the verdicts do not show, such as actions of users.
    """
    timed = [each for each in items if each[0].time]
    verdicts = [verdict for verdict, _ in timed]
    found = [*changes, *_changes(verdicts)]
    return History(
        np.array([_stamp_of(each) for each in verdicts], np.int64),
        np.array([each.decision for each in verdicts], np.int64),
        GRAMS * np.array([each.mass for each in verdicts], np.float64),
        GRAMS * np.array([zero for _, zero in timed], np.float64),
        np.array([*noise], np.float64).reshape(-1, 2),
        tuple(sorted(found)),
    )


def _stamp_of(verdict: Verdict) -> int:
    return verdict.time or 0


def _changes(verdicts: list[Verdict]) -> Iterable[Change]:
    """Yield the changes between successive items, each with the time of the later item in ns.

    At most one change is yielded for an item. A change of the batch is left out if the product also
    changes, and a change of the limits is left out if the product or the batch also changes.
    """
    for one, other in pairwise(verdicts):
        if one.product != other.product:
            name = other.product or Text('none')
            yield _stamp_of(other), Text('product {name}', name=name)
        elif one.batch != other.batch:
            name = other.batch or Text('none')
            yield _stamp_of(other), Text('batch {name}', name=name)
        elif (one.lower_limit, one.upper_limit) != (other.lower_limit, other.upper_limit):
            lower, upper = Mass(other.lower_limit), Mass(other.upper_limit)
            text = Text('limits {lower} and {upper}', lower=lower, upper=upper)
            yield _stamp_of(other), text


@dataclass(frozen=True, slots=True)
class Intervals:
    """Means of a history in intervals of equal length, as arrays of shape (k,).

    `times` contains the middle of each interval in ns. `rates` contains the items per minute, and
    `rejects` the fraction of the items that were not accepted. `means` and `std_devs` contain the
    mean and the standard deviation of the gross masses of the accepted items in g. `zeros` contains
    the mean of the known zeros of the items in g, relative to the zero of calibration. A value for
    which an interval has too few items is NaN. The rate of an interval without items is 0.
    """

    times: NDArray[Any]
    rates: NDArray[np.float64]
    rejects: NDArray[np.float64]
    means: NDArray[np.float64]
    std_devs: NDArray[np.float64]
    zeros: NDArray[np.float64]


def intervals(history: History, begin: int, end: int, count: int) -> Intervals:
    """Return the means of a history in `count` intervals from `begin` to `end` in ns."""
    length = max(end - begin, 1) / count
    places = np.floor((history.stamps - begin) / length).astype(int)
    inside = (places >= 0) & (places < count)
    accepted = inside & (history.decisions == Decision.ACCEPT)

    def summed(where: NDArray[np.bool_], values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(places[where], values[where], count).astype(np.float64)

    ones = np.ones(len(places))
    weighed, zeroed = accepted & np.isfinite(history.masses), inside & np.isfinite(history.zeros)
    with np.errstate(divide='ignore', invalid='ignore'):
        items, number = summed(inside, ones), summed(weighed, ones)
        means = summed(weighed, history.masses) / number
        deviations = (history.masses - means[np.clip(places, 0, count - 1)]) ** 2
        return Intervals(
            begin + length * (np.arange(count) + 0.5),
            items * 60 * NANOSECONDS / length,
            1 - summed(accepted, ones) / items,
            means,
            np.sqrt(summed(weighed, deviations) / np.maximum(number - 1, 0)),
            summed(zeroed, history.zeros) / summed(zeroed, ones),
        )
