# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Known masses of passes, and groups of passes by belt speed."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_core.records import Eye, EyeEdge, Reference, WeighWindow
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate
from checkweigher_validation.accuracy.passes import (
    KnownPass,
    ReferenceMasses,
    SpeedGroup,
    evenly_chosen,
    group_by_speed,
    known_passes,
)

MILLISECOND = 1_000_000  # ns
SLACK = 10 * MILLISECOND  # largest difference between a reference and t1


class TestReferences:
    def test_an_item_has_the_mass_that_carries_its_t1(self):
        masses = ReferenceMasses([Reference(5_000 * MILLISECOND, 0.2), Reference(0, 0.1)])
        assert masses.at(0) == 0.1
        assert masses.at(5_000 * MILLISECOND) == 0.2

    @pytest.mark.parametrize('off', [-SLACK, SLACK])
    def test_ten_milliseconds_beside_t1_will_do_and_no_more(self, off):
        masses = ReferenceMasses([Reference(10**18, 0.1)])
        assert masses.at(10**18 + off) == 0.1
        assert math.isnan(masses.at(10**18 + off + (1 if off > 0 else -1)))

    def test_the_nearer_of_two_counts(self):
        masses = ReferenceMasses([Reference(0, 0.1), Reference(8 * MILLISECOND, 0.2)])
        assert masses.at(3 * MILLISECOND) == 0.1
        assert masses.at(5 * MILLISECOND) == 0.2

    def test_an_item_without_t1_and_a_line_without_references_have_no_mass(self):
        assert math.isnan(ReferenceMasses([Reference(0, 0.1)]).at(None))
        assert math.isnan(ReferenceMasses([]).at(0))

    @given(
        st.lists(st.integers(0, 10**6), unique=True, min_size=1, max_size=30),
        st.randoms(use_true_random=False),
        st.integers(-SLACK, SLACK),
    )
    def test_among_items_30_ms_apart_each_finds_its_own(self, places, random, off):
        references = [Reference(30 * MILLISECOND * place, 1e-6 * (1 + place)) for place in places]
        random.shuffle(references)
        masses = ReferenceMasses(references)
        assert all(masses.at(each.stamp + off) == each.mass for each in references)


class TestKnownPasses:
    LINE = simulate(SimulationParameters(count=6, masses=(0.1, 0.2), speed=1.0))

    def known(self, change=lambda event: event):
        events = [changed for event in self.LINE if (changed := change(event)) is not None]
        return known_passes(self.LINE.load_cell, events, SegmenterParameters())

    def test_they_come_in_order_of_entry_with_their_masses(self):
        known = self.known()
        assert [each.window.item_id for each in known] == [1, 2, 3, 4, 5, 6]
        assert [each.mass for each in known] == [0.1, 0.2] * 3
        assert all(each.whole for each in known)

    @pytest.mark.parametrize('mass', [None, 0.0])
    def test_one_without_a_mass_that_can_be_is_left_out(self, mass):
        third = self.LINE.references[2]

        def change(event):
            if event is third:
                return None if mass is None else replace(third, mass=mass)
            return event

        assert [each.window.item_id for each in self.known(change)] == [1, 2, 4, 5, 6]

    def test_a_fault_of_known_mass_is_kept_and_not_whole(self):
        outfeed = [e for e in self.LINE.edges if e.eye == Eye.OUTFEED][2:4]  # of the second item

        known = self.known(
            lambda event: None if isinstance(event, EyeEdge) and event in outfeed else event
        )
        assert len(known) == 6
        assert not known[1].whole
        assert known[1].mass == 0.2


def a_pass(speed, mass=0.1, item_id=1, reasons=()):
    return KnownPass(WeighWindow(item_id, 0, 1, 2, belt_speed=speed, reasons=reasons), mass)


class TestSpeeds:
    def test_groups_are_slowest_first_and_keep_the_order_of_the_passes(self):
        speeds = (1.5, 1.001, 1.0, 1.503, 0.999)
        passes = [a_pass(speed, item_id=number) for number, speed in enumerate(speeds)]
        passes.append(a_pass(1.0, reasons=('Saturation',)))
        slow, fast = group_by_speed(passes)
        assert [each.window.item_id for each in slow.passes] == [1, 2, 4]
        assert [each.window.item_id for each in fast.passes] == [0, 3]
        assert (slow.speed, fast.speed) == pytest.approx((1.0, 1.5015), rel=1e-12)

    def test_without_a_whole_pass_there_is_no_group(self):
        assert group_by_speed([a_pass(1.0, reasons=('Saturation',))]) == ()

    @given(st.lists(st.floats(0.1, 3.0), min_size=1, max_size=40))
    def test_each_pass_is_in_one_group_at_a_speed_that_counts_as_trained_for_it(self, speeds):
        tolerance = IdentifierParameters().speed_tolerance
        passes = [a_pass(speed, item_id=number) for number, speed in enumerate(speeds)]
        groups = group_by_speed(passes)
        found = [each.window.item_id for group in groups for each in group.passes]
        assert sorted(found) == list(range(len(speeds)))
        for group in groups:
            for each in group.passes:
                assert abs(each.window.belt_speed / group.speed - 1) <= tolerance
        assert np.all(np.diff([group.speed for group in groups]) > 0)

    def test_a_spread_has_each_mass_equally_often_and_reaches_over_the_run(self):
        masses = (0.3, 0.1, 0.2) * 20
        group = SpeedGroup(1.0, tuple(a_pass(1.0, m, n) for n, m in enumerate(masses)))
        chosen = evenly_chosen(group, 12)
        assert sorted(each.mass for each in chosen) == [0.1] * 4 + [0.2] * 4 + [0.3] * 4
        for mass in (0.1, 0.2, 0.3):
            numbers = [each.window.item_id for each in chosen if each.mass == mass]
            assert min(numbers) < 20 < 40 <= max(numbers)

    def test_a_spread_of_a_small_group_is_all_of_it(self):
        group = SpeedGroup(1.0, tuple(a_pass(1.0, 0.1, n) for n in range(4)))
        assert list(evenly_chosen(group, 20)) == list(group.passes)
