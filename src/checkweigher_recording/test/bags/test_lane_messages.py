# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bag in stretches: the same events as all at once, in the same order, or a clear refusal."""

from dataclasses import replace
import random

from foreign_bags import messages_of, same, write_mcap
from lines import write_line
import pytest

from checkweigher_core.recording import Recording
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.lane_messages import OutOfOrderError
from checkweigher_recording.bags.reading import read_bag, read_stretches
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

SECOND = 10**9  # ns


@pytest.fixture(scope='module')
def long_recording():
    """Three and a half minutes, in many small blocks."""
    return simulate(SimulationParameters(count=300, samples_per_block=10))


@pytest.fixture
def timed(long_recording):
    """Messages with their log times."""
    return [(message, message.stamp) for message in messages_of(long_recording)]


def joined(parts):
    """Return the recording that stretches are of, the line on its end among it."""
    return replace(
        Recording.from_events(parts[0].load_cell, (event for part in parts for event in part)),
        warning=parts[-1].warning,
    )


def test_stretches_have_all_events_in_their_order(tmp_path, long_recording):
    parts = list(read_stretches(write_line(tmp_path / 'bag', long_recording)))

    assert len(parts) > 3
    assert all(len(part.blocks) for part in parts)
    assert same(joined(parts), long_recording)
    stamps = [event.stamp for part in parts for event in part]
    assert stamps == sorted(stamps)


def test_messages_that_were_logged_late_are_put_in_order(tmp_path, long_recording, timed):
    chance = random.Random(1)
    late = [(message, stamp + chance.randrange(50 * SECOND)) for message, stamp in timed]
    write_mcap(tmp_path / 'late.mcap', late)

    assert same(joined(list(read_stretches(tmp_path / 'late.mcap'))), long_recording)


def test_messages_that_are_too_late_for_stretches_are_read_as_a_whole(
    tmp_path, long_recording, timed
):
    late = next(n for n, (message, _) in enumerate(timed) if message.topic == '/photo_eyes')
    timed[late] = (timed[late][0], timed[-1][1])
    write_mcap(tmp_path / 'late.mcap', timed)

    with pytest.raises(OutOfOrderError, match=r'late.mcap: contains messages that are more than'):
        list(read_stretches(tmp_path / 'late.mcap'))
    assert same(read_bag(tmp_path / 'late.mcap'), long_recording)


def test_a_load_cell_that_is_logged_last_is_that_of_the_first_stretch(
    tmp_path, long_recording, timed
):
    (cell, _), *rest = timed
    write_mcap(tmp_path / 'line.mcap', [*rest, (cell, rest[-1][1])])

    assert same(joined(list(read_stretches(tmp_path / 'line.mcap'))), long_recording)


def test_a_load_cell_that_changes_later_ends_the_stretches(tmp_path, timed):
    other = replace(timed[0][0], content=timed[0][0].content | {'zero_counts': 1.0})
    write_mcap(tmp_path / 'line.mcap', [*timed, (other, timed[-1][1])])

    stretches = read_stretches(tmp_path / 'line.mcap')

    assert len(next(stretches).blocks)
    with pytest.raises(BagError, match='load_cell/info changes'):
        list(stretches)


def test_a_recording_that_broke_off_says_so_with_its_last_stretch(tmp_path, long_recording):
    bag = write_line(tmp_path / 'bag', long_recording)
    (bag / 'metadata.yaml').unlink()
    file = bag / 'line_0.mcap'
    file.write_bytes(file.read_bytes()[: -(file.stat().st_size // 8)])

    whole, parts = read_bag(bag), list(read_stretches(bag))

    assert 'the recording broke off' in whole.warning
    assert joined(parts).warning == whole.warning
    assert same(joined(parts), whole)
    assert not any(part.warning for part in parts[:-1])
