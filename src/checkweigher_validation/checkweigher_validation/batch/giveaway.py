# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Giveaway of accepted items in kg and in money, by shift, day or month of the local time."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import time, timedelta
import math

from checkweigher_core.records import Decision, local_time
from checkweigher_production.recipes import Product
from checkweigher_validation.batch.batch import Batch, BatchItem

# Function that returns the name of the period to which a time in ns belongs.
Period = Callable[[int], str]


@dataclass(frozen=True, slots=True)
class Giveaway:
    """Contents of one product beyond the nominal weight in one period. Masses are in kg."""

    period: str
    product: str
    items: int  # number of accepted items
    nominal: float  # sum of the nominal weights
    surplus: float  # sum of the contents minus `nominal`
    price: float  # price of the contents per kg, NaN if unknown

    @property
    def money(self) -> float:
        """Price of the surplus in the currency of `price`, NaN if the price is unknown."""
        return self.price * self.surplus


def day(stamp: int) -> str:
    """Return the date of a time in ns in the local time zone, as YYYY-MM-DD."""
    return local_time(stamp).date().isoformat()


def month(stamp: int) -> str:
    """Return the month of a time in ns in the local time zone, as YYYY-MM."""
    return day(stamp)[:7]


def shift(stamp: int, begins: Sequence[time]) -> str:
    """Return date and local time of the beginning of the shift to which a time in ns belongs.

    `begins` contains the times of day at which the shifts begin, at least one.
    """
    moment = local_time(stamp)
    before = [each for each in begins if each <= moment.time()]
    began = moment.date() if before else moment.date() - timedelta(1)
    return f'{began} {max(before or begins):%H:%M}'


def giveaway(batches: Iterable[Batch], period: Period, price: float = math.nan) -> list[Giveaway]:
    """Return the giveaway of each product in each period, in the order of periods and products.

    `price` is the price per kg of all products, or NaN to use the prices of the recipes. Items
    without a time belong to the period 'no time'. A product with two prices in a period has two
    entries.
    """
    found: dict[tuple[str, str, float], list[tuple[float, float]]] = {}
    for product, item in _accepted(batches):
        when = period(item.stamp) if item.stamp else 'no time'
        key = when, product.name, product.price if math.isnan(price) else price
        found.setdefault(key, []).append((product.nominal, item.mass - product.nominal))
    return [
        Giveaway(
            when,
            name,
            len(items),
            nominal=math.fsum(each for each, _ in items),
            surplus=math.fsum(each for _, each in items),
            price=own,
        )
        for (when, name, own), items in sorted(found.items(), key=lambda each: each[0][:2])
    ]


def _accepted(batches: Iterable[Batch]) -> Iterator[tuple[Product, BatchItem]]:
    """Yield the accepted items of the products with a nominal mass, each with its product."""
    for part in (part for batch in batches for part in batch.parts):
        if math.isfinite(part.product.nominal):
            accepted = (item for item in part.items if item.decision is Decision.ACCEPT)
            yield from ((part.product, item) for item in accepted)
