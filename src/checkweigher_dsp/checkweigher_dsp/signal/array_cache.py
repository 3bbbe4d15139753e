# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A cache for arrays that follow from the length of a window."""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import wraps
from typing import Any, TypeVar

R = TypeVar('R')
_MOST = 2**23  # bytes in one cache
_LARGEST = 2**21  # bytes of one entry: a longer window is rare, and computed again


def array_cache(function: Callable[..., R]) -> Callable[..., R]:
    """Cache the arrays that a function returns, up to 8 MB: ``lru_cache`` counts no bytes.

    The arguments are positional and hashable, the result is an array or a tuple with arrays. One
    of more than 2 MB is made each time.
    """
    entries: OrderedDict[Hashable, tuple[R, int]] = OrderedDict()
    held = 0

    @wraps(function)
    def call(*arguments: Any) -> R:
        nonlocal held
        if found := entries.pop(arguments, None):
            entries[arguments] = found  # as the latest
            return found[0]
        result = function(*arguments)
        parts = result if isinstance(result, tuple) else (result,)
        size = sum(getattr(part, 'nbytes', 0) for part in parts)
        if size <= _LARGEST and arguments not in entries:
            entries[arguments] = result, size
            held += size
            while held > _MOST:
                held -= entries.popitem(last=False)[1][1]
        return result

    return call
