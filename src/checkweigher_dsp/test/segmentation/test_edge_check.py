# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the lags of items, one after the other, mean for the window of each."""

from collections.abc import Iterable

import pytest

from checkweigher_dsp.segmentation.edge_check import EdgeCheck
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import Bend, RiseLag

MS = 1e-3
SPEED, LENGTH = 1.0, 0.1  # a rise of 100 ms
STATED = SegmenterParameters().rise_lag


def rise(lag: float, std_dev: float = 0.1, bend: float = 0.0) -> RiseLag:
    """Return a rise that lags by so much more than is stated, ms."""
    return RiseLag(STATED + MS * lag, MS * std_dev, lambda: Bend(MS * bend, MS * 0.5))


def shifts(
    check: EdgeCheck, lags: Iterable[float], speed: float = SPEED, bend: float = 0.0
) -> list[float | None]:
    """Return the shifts of items with these lags beyond the stated one, ms; None is a mismatch."""
    found = [check.check(rise(lag, bend=bend), speed, LENGTH) for lag in lags]
    return [None if shift is None else round(shift / MS, 6) for shift in found]


def test_a_lag_within_its_uncertainty_moves_nothing():
    assert shifts(EdgeCheck(SegmenterParameters()), [0.3, -0.4, 0.0, 0.5, -0.2]) == [0.0] * 5


def test_a_lag_that_is_sure_moves_the_window_from_the_first_item_on():
    assert shifts(EdgeCheck(SegmenterParameters()), [5.0, 5.2, -3.0]) == [5.0, 5.2, -3.0]
    assert shifts(EdgeCheck(SegmenterParameters()), [5.0, 5.2, 5.1])[-1] == 5.1


def test_a_lag_that_may_be_that_of_the_items_before_is_theirs():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [1.0, 1.1, 1.0])

    assert check.check(rise(0.6, std_dev=0.3), SPEED, LENGTH) == pytest.approx(MS)
    assert check.check(rise(0.1, std_dev=0.2), SPEED, LENGTH) == 0.0


def test_an_item_that_is_not_like_those_before_is_a_mismatch():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [6.3] * 5)

    # 3 ms, 2 % of the rise and 4 standard deviations: 5.4 ms.
    assert shifts(check, [11.6, 11.8, 1.0, 0.8]) == [11.6, None, 1.0, None]


def test_a_lasting_change_stays_a_mismatch():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [0.0] * 5)

    assert set(shifts(check, [15.0] * 100)) == {None}
    assert check.change == pytest.approx(15 * MS)
    assert shifts(check, [0.0]) == [0.0]


def test_nothing_confirms_an_item_whose_rise_is_not_seen_after_a_lasting_change():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [0.0] * 5)
    assert check.check(RiseLag(), SPEED, LENGTH) == 0.0
    shifts(check, [15.0] * 3)

    assert check.check(RiseLag(), SPEED, LENGTH) is None
    assert (check.checked, check.unchecked) == (8, 2)


@pytest.mark.parametrize(('lag', 'shift'), [(25.0, 25.0), (26.0, None), (-26.0, None)])
def test_what_no_machine_has_is_a_mismatch_from_the_first_item_on(lag: float, shift: float | None):
    # 10 ms, 15 % of the rise and 4 standard deviations: 25.4 ms.
    assert shifts(EdgeCheck(SegmenterParameters()), [lag]) == [shift]


def test_a_stated_lag_holds_from_the_first_item_on_and_with_its_part_that_goes_with_speed():
    known = SegmenterParameters(rise_lag=0.004, rise_lag_distance=0.003, rise_lag_known=True)
    check = EdgeCheck(known)

    # 4 ms and 3 mm at 0.5 m/s: 10 ms, of which STATED has 0.5. The rise takes 200 ms.
    assert shifts(check, [9.5, 13.5, 17.0, 2.0], speed=0.5) == [0.0, 4.0, None, None]


def test_a_bend_of_the_products_is_no_reason_to_move_a_window():
    assert shifts(EdgeCheck(SegmenterParameters()), [15.0, 15.0, 15.0], bend=12.0) == [3.0] * 3
    # Ringing may look like one, all passes alike: it moves none that the lag would leave.
    assert shifts(EdgeCheck(SegmenterParameters()), [-0.5, 0.2, -2.0], bend=4.5) == [0, 0, -2.0]


def test_an_item_that_rides_on_in_its_own_way_is_no_mismatch():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [6.3] * 5)

    # As much of the lag as the bend shows, where it surely is one, is the item's own.
    assert shifts(check, [16.3], bend=9.0) == [7.3]
    assert shifts(check, [-3.7], bend=-10.0) == [6.3]
    assert shifts(check, [16.3, 16.3, -3.7], bend=1.9) == [None] * 3
    assert shifts(check, [-3.7], bend=10.0) == [None]


def test_where_the_bend_hides_a_lag_the_doubt_is_what_lies_between():
    check = EdgeCheck(SegmenterParameters())

    assert shifts(check, [0.0, 0.2, 0.1], bend=6.0) == [0.0] * 3
    assert check.shift_std_dev == pytest.approx(5.9 * MS / 12**0.5)
    shifts(check, [6.1] * 3, bend=6.0)
    assert check.shift_std_dev == 0.0


def test_another_speed_or_length_is_learned_again():
    check = EdgeCheck(SegmenterParameters())
    shifts(check, [0.0] * 5)

    assert shifts(check, [8.0], speed=1.2) == [8.0]
