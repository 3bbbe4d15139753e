# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Equality of records that contain NaN."""

from dataclasses import fields
import math
from typing import Any

import numpy as np


class NanEqual:
    """Base class of dataclasses that are equal if all fields are equal, where NaN equals NaN.

    From Python 3.13 on, the `==` of a dataclass compares field by field, so a record with a NaN
    would differ from itself. A subclass must be a dataclass with `eq=False`, because otherwise the
    dataclass would replace this comparison by its own.
    """

    __slots__ = ()

    def __eq__(self, other: object) -> bool:
        return _values(self) == _values(other) if type(other) is type(self) else NotImplemented

    def __hash__(self) -> int:
        return hash(_values(self))


def _values(record: Any) -> tuple[object, ...]:
    return tuple(_plain(getattr(record, each.name)) for each in fields(record) if each.compare)


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return tuple(map(_plain, value))
    return 'NaN' if isinstance(value, float) and math.isnan(value) else value
