# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A recorded shift gives the items and windows of the line, and reads samples only on demand."""

from dataclasses import replace

from lines import edges_of, saturated_at, simulated, without_edges
import numpy as np
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import EyeEdge, SampleBlock
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.shift import Playback, Shift

PARAMETERS = LineParameters()
FAULTS = [3, 7]  # places


@pytest.fixture(scope='module')
def recording() -> Recording:
    sound = simulated(count=10, seed=5)
    broken = saturated_at(sound, edges_of(sound, 3)['t2'].stamp + 50_000_000)
    broken = without_edges(broken, edges_of(sound, 7)['t2'])
    return replace(broken, blocks=BlockColumns.of(broken.blocks))


@pytest.fixture(scope='module')
def shift(recording: Recording) -> Shift:
    found = Shift(recording, PARAMETERS)
    found.index()
    return found


def test_items_are_those_of_weigh_with_the_faults_among_them(shift: Shift, recording: Recording):
    results = weigh(recording, PARAMETERS)
    assert [item.estimate for item in shift.items] == [each.estimate for each in results]
    assert [item.verdict for item in shift.items] == [each.verdict for each in results]
    assert [item.t4 for item in shift.items] == [each.t4 for each in results]
    assert shift.faults == FAULTS
    assert (shift.progress, shift.is_whole) == (1.0, True)


def test_samples_lie_in_files_and_items_have_none(shift: Shift):
    blocks = BlockColumns.of(shift.recording.blocks)
    assert all(isinstance(c, np.memmap) for c in (blocks.counts, blocks.stamps, blocks.lengths))
    assert all(item.window is None and item.stretch is None for item in shift.items)


def test_a_window_is_read_as_it_was_cut(shift: Shift, recording: Recording):
    events = (e for e in recording if isinstance(e, SampleBlock | EyeEdge))
    line = WeighingLine(recording.load_cell, PARAMETERS)
    windows = [each.window for each in line.weigh_all(events)]
    denoiser = Denoiser(PARAMETERS.denoise)
    for place in (0, 5, 9):
        expected = windows[place]
        denoised, found = denoiser.denoise(expected), shift.with_signals(place).window
        np.testing.assert_array_equal(found.denoised, denoised.denoised)  # NaN outside
        nothing = np.zeros(0)
        assert replace(found, denoised=nothing) == replace(denoised, denoised=nothing)


def test_a_fault_has_the_stretch_that_a_lane_shows(shift: Shift, recording: Recording):
    lane = lane_of(recording)
    for place, of_lane in zip(FAULTS, reversed(lane.faults()), strict=True):
        found, expected = shift.with_signals(place).stretch, lane.with_signals(of_lane).stretch
        assert np.array_equal(found.counts, expected.counts)
        assert np.array_equal(found.time, expected.time)
        assert found.edges == expected.edges


def test_playback_shows_the_shift_until_a_place(shift: Shift):
    playback = Playback(shift, 'a')
    playback.go(5)
    assert [item.verdict.item_id for item in playback.items()] == [6, 5, 4, 3, 2, 1]
    assert [item.verdict.item_id for item in playback.faults()] == [4]
    assert playback.with_signals(playback.items()[1]).window is not None
    assert (playback.statistics.items, playback.statistics.faults) == (6, 1)
    assert len(playback.empty_belt()) > 0
    before = playback.version
    assert (playback.next_fault(forward=True), playback.next_fault(forward=False)) == (7, 3)
    playback.go(7)
    assert playback.version != before
    assert playback.next_fault(forward=True) is None
    playback.go(99)
    assert playback.place == 9


def test_a_shift_that_is_not_weighed_yet_shows_nothing(recording: Recording):
    playback = Playback(Shift(recording, PARAMETERS), 'a')
    playback.go(4)
    assert (playback.items(), playback.faults(), playback.place) == ([], [], 0)
    assert not len(playback.empty_belt())
    assert playback.shift.progress == 0
