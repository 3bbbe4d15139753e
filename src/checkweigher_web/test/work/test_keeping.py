# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items that the page writes from the held samples of a simulated line."""

import asyncio
from dataclasses import replace
from pathlib import Path

from lines import simulated
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, SampleBlock
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.reading import read_bag
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.lane import Lane, ShownItem
from checkweigher_web.work.keeping import HELD, Keeper
from checkweigher_web.work.services import ActionRefusedError

DEFAULTS = LineParameters()


@pytest.fixture(scope='module')
def recording() -> Recording:
    return simulated(count=40, seed=4)


def held_of(recording: Recording) -> Lane:
    return lane_of(recording, held=HELD)


def keep(folder: Path, held: Lane, item: ShownItem, parameters: LineParameters = DEFAULTS) -> str:
    return asyncio.run(Keeper(folder).keep('a/b', held.recording(), parameters, item))


def test_an_item_is_kept_with_what_its_mass_needs(recording: Recording, tmp_path: Path):
    lane = held_of(recording)
    item = lane.items()[20]
    text = keep(tmp_path, lane, item)
    (bag,) = tmp_path.iterdir()
    assert text.startswith(f'{bag}: ')
    assert bag.name.startswith(f'a_b_item{item.verdict.item_id}_')
    part = read_bag(bag, 'a/b')
    assert part.load_cell == recording.load_cell
    assert len(part.blocks) < len(recording.blocks)
    (found,) = [each for each in weigh(part, DEFAULTS) if each.verdict.t1 == item.verdict.t1]
    assert found.verdict.decision == item.verdict.decision
    assert abs(found.verdict.mass - item.verdict.mass) < 0.1 * item.verdict.std_dev
    assert f'item {found.verdict.item_id} of this bag' in text
    with pytest.raises(ActionRefusedError, match='exists already'):
        keep(tmp_path, lane, item)


def test_an_item_whose_signal_is_not_held_is_refused_in_words(recording: Recording, tmp_path: Path):
    lane = held_of(recording)
    items = lane.items()
    with pytest.raises(ActionRefusedError, match='weighed another way'):
        keep(tmp_path, lane, items[0], DEFAULTS.with_values({'reject.lower_limit': 9.0}))
    with pytest.raises(ActionRefusedError, match='no place in the signal'):
        keep(tmp_path, lane, replace(items[0], estimate=None))
    # The next block is `HELD` - 5 s later, so the samples of the first items are dropped.
    last = recording.blocks[-1]
    later = last.stamp + round((HELD - 5) * NANOSECONDS)
    lane.take(SampleBlock(later, last.first_index + 10**6, last.counts))
    held = lane.recording()
    assert held.blocks[-1].stamp - held.blocks[0].stamp <= HELD * NANOSECONDS
    with pytest.raises(ActionRefusedError, match='came before what the page holds'):
        keep(tmp_path, lane, items[-1])
    lane.forget_signals()
    with pytest.raises(ActionRefusedError, match='while somebody looks'):
        keep(tmp_path, lane, items[0])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('open_page', [True, False])
def test_of_a_source_that_begins_again_nothing_from_before_is_held(
    recording: Recording, tmp_path: Path, open_page: bool
):
    lane = held_of(recording)
    for edge in recording.edges * 3:  # as many as the lane holds
        lane.take(edge)
    item = lane.items()[20]
    if not open_page:  # without blocks, only the load cell shows the restart
        lane.forget_signals()
        lane.take(recording.load_cell)
    for hours in (1, 2):
        earlier = hours * 3600 * NANOSECONDS
        blocks = [replace(each, stamp=each.stamp - earlier) for each in recording.blocks[:3]]
        for block in blocks:
            lane.take(block)
        held = lane.recording()
        assert (held.blocks, held.edges, held.references) == (tuple(blocks), (), ())
        with pytest.raises(ActionRefusedError, match='weighed another way'):
            keep(tmp_path, lane, item)


def test_a_recording_begins_where_all_edges_are_held(recording: Recording):
    lane = held_of(recording)
    first = lane.recording()
    assert first.edges == recording.edges
    for edge in recording.edges * 3:  # more than the lane holds
        lane.take(edge)
    held = lane.recording()
    assert held.blocks[0].stamp >= held.edges[0].stamp > first.blocks[0].stamp
    for edge in recording.edges * 3:  # all later than the samples
        lane.take(replace(edge, stamp=edge.stamp + 3600 * NANOSECONDS))
    assert lane.recording() is None
