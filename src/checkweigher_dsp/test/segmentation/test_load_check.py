# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A load that changes within the window is not that of one product alone."""

import numpy as np
from numpy.typing import NDArray
import pytest

from checkweigher_dsp.segmentation.load_check import LoadCheck

ZERO, LOAD, SIZE = 1_250_000, 100_000, 96


def _window(change: float) -> NDArray[np.int32]:
    """Return a load whose last quarter is by `change` of it above its first half."""
    counts = np.full(SIZE, ZERO + LOAD, np.int32)
    counts[-SIZE // 4 :] += round(change * LOAD)
    return counts


def _belt(shaking: float, size: int = 480) -> NDArray[np.int32]:
    """Return an empty belt that shakes by this amplitude, at ten periods in a window."""
    swing = shaking * LOAD * np.sin(2 * np.pi * 10 * np.arange(size) / SIZE)
    return np.rint(ZERO + swing).astype(np.int32)


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize(('change', 'steady'), [(0.0, True), (0.06, True), (0.12, False)])
def test_a_load_that_changes_by_more_than_ring_down_is_not_steady(
    change: float, steady: bool, direction: int
):
    check = LoadCheck()

    # The mean of the window is a quarter of the change above LOAD.
    assert check.is_steady(_window(direction * change), _belt(0.0), ZERO) is steady


def test_the_gain_and_the_sign_of_the_load_cell_do_not_matter():
    for gain in (-1, 3):
        window, belt = gain * _window(0.2), gain * _belt(0.0)

        assert not LoadCheck().is_steady(window, belt, gain * ZERO)


def test_a_belt_that_shakes_as_much_explains_a_change():
    slow = np.rint(ZERO + 0.2 * LOAD * np.sin(2 * np.pi * np.arange(480) / SIZE)).astype(np.int32)

    assert LoadCheck().is_steady(_window(0.2), slow, ZERO)


def test_what_the_belt_showed_last_holds_where_it_is_never_empty():
    check = LoadCheck()
    check.is_steady(_window(0.0), _belt(0.0), ZERO)

    assert not check.is_steady(_window(0.2), _belt(0.0, size=10), ZERO)


@pytest.mark.parametrize('size', [0, 10, SIZE - 1])
def test_a_belt_that_was_never_seen_empty_for_long_is_taken_for_one_that_does_not_shake(size: int):
    falling = _belt(0.0, size) - np.linspace(0, LOAD, size).astype(np.int32)

    for belt in (_belt(0.0, size), falling):  # while something leaves that no eye has seen
        assert LoadCheck().is_steady(_window(0.06), belt, ZERO)
        assert not LoadCheck().is_steady(_window(0.12), belt, ZERO)


def test_a_short_segment_counts_until_a_longer_one_is_seen():
    check = LoadCheck()
    swing = 0.3 * LOAD * np.sin(5 * np.pi * np.arange(SIZE - 1) / SIZE)
    shaking = np.rint(ZERO + swing).astype(np.int32)

    assert check.is_steady(_window(0.2), shaking, ZERO)
    assert not check.is_steady(_window(0.2), _belt(0.0), ZERO)
    assert not check.is_steady(_window(0.2), shaking, ZERO)
