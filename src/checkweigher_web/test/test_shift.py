# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items, windows and samples of a recorded shift, compared with the line."""

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
from checkweigher_web.shift import Shift

PARAMETERS = LineParameters()
FAULTS = [3, 7]  # indices of the faults


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
    items = shift.items()[::-1]
    assert [item.estimate for item in items] == [each.estimate for each in results]
    assert [item.verdict for item in items] == [each.verdict for each in results]
    assert [item.t4 for item in items] == [each.t4 for each in results]
    assert shift.faults() == [items[place] for place in reversed(FAULTS)]
    assert (shift.progress, shift.is_whole) == (1.0, True)


def test_samples_lie_in_files_and_items_have_none(shift: Shift):
    blocks = BlockColumns.of(shift.recording.blocks)
    assert all(isinstance(c, np.memmap) for c in (blocks.counts, blocks.stamps, blocks.lengths))
    assert all(item.window is None and item.stretch is None for item in shift.items())


def test_a_window_is_read_as_it_was_cut(shift: Shift, recording: Recording):
    events = (e for e in recording if isinstance(e, SampleBlock | EyeEdge))
    line = WeighingLine(recording.load_cell, PARAMETERS)
    windows = [each.window for each in line.weigh_all(events)]
    denoiser = Denoiser(PARAMETERS.denoise)
    items = shift.items()[::-1]
    for place in (0, 5, 9):
        expected = windows[place]
        denoised, found = denoiser.denoise(expected), shift.with_signals(items[place]).window
        np.testing.assert_array_equal(found.denoised, denoised.denoised)  # both are NaN outside
        nothing = np.zeros(0)
        assert replace(found, denoised=nothing) == replace(denoised, denoised=nothing)


def test_a_fault_has_the_stretch_that_a_lane_shows(shift: Shift, recording: Recording):
    lane = lane_of(recording)
    for item, of_lane in zip(shift.faults(), lane.faults(), strict=True):
        found, expected = shift.with_signals(item).stretch, lane.with_signals(of_lane).stretch
        assert np.array_equal(found.counts, expected.counts)
        assert np.array_equal(found.time, expected.time)
        assert found.edges == expected.edges


def test_a_shift_is_shown_as_a_whole_or_in_part(shift: Shift):
    assert [item.verdict.item_id for item in shift.items()] == [*range(10, 0, -1)]
    assert [item.verdict.item_id for item in shift.faults()] == [8, 4]
    assert (shift.statistics.items, shift.statistics.faults) == (10, 2)
    assert shift.series.masses == tuple(
        each.verdict.mass for each in reversed(shift.items()) if each not in shift.faults()
    )
    first, *_, last = shift.history().stamps[2:7].tolist()
    assert [item.verdict.item_id for item in shift.items((first, last))] == [7, 6, 5, 4, 3]
    assert [item.verdict.item_id for item in shift.faults((first, last))] == [4]
    assert len(shift.empty_belt(shift.items()[4])) > 0


def test_a_shift_that_is_not_weighed_yet_shows_nothing(recording: Recording):
    shift = Shift(recording, PARAMETERS)
    assert (shift.items(), shift.faults(), shift.version) == ([], [], 0)
    assert not len(shift.empty_belt())
    assert shift.progress == 0
