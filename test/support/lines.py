# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded lines for the tests, with faults put in where a test wants them."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import Recording
from checkweigher_core.records import Eye, EyeEdge, SampleBlock
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


def simulated(**parameters: object) -> Recording:
    """Return a simulated line."""
    return simulate(SimulationParameters.from_mapping(parameters))


def counts_of(recording: Recording) -> NDArray[np.int32]:
    """Return all samples; the recording must have no gap."""
    return np.concatenate([block.counts for block in recording.blocks])


def grams_of(recording: Recording) -> NDArray[np.float64]:
    """Return the readings in g; the recording must have no gap."""
    cell = recording.load_cell
    return (counts_of(recording) - cell.zero_counts) / cell.counts_per_kg * 1000


def reblocked(recording: Recording, sizes: list[int]) -> Recording:
    """Return the same samples in blocks of other sizes, taken in turn."""
    counts = counts_of(recording)
    begin = recording.blocks[0].stamp
    rate = recording.load_cell.sample_rate
    blocks, first = [], 0
    while first < len(counts):
        size = sizes[len(blocks) % len(sizes)]
        stamp = begin + round(first * 1e9 / rate)
        blocks.append(SampleBlock(stamp, first, counts[first : first + size]))
        first += size
    return replace(recording, blocks=tuple(blocks))


def amplified(recording: Recording, gain: int) -> Recording:
    """Return the same line on a load cell with `gain` times the sensitivity."""
    cell = recording.load_cell
    return replace(
        recording,
        load_cell=replace(
            cell,
            counts_per_kg=gain * cell.counts_per_kg,
            zero_counts=gain * cell.zero_counts,
            min_counts=-(2**31),
            max_counts=2**31 - 1,
        ),
        blocks=tuple(replace(block, counts=gain * block.counts) for block in recording.blocks),
    )


def edges_of(recording: Recording, item: int) -> dict[str, EyeEdge]:
    """Return t1 to t4 of an item, counted from 0, of a line without faults."""
    names = {
        (Eye.INFEED, True): 't1',
        (Eye.INFEED, False): 't2',
        (Eye.OUTFEED, True): 't3',
        (Eye.OUTFEED, False): 't4',
    }
    found: dict[str, EyeEdge] = {}
    for (eye, blocked), name in names.items():
        of_kind = [edge for edge in recording.edges if (edge.eye, edge.blocked) == (eye, blocked)]
        found[name] = of_kind[item]
    return found


def without_edges(recording: Recording, *lost: EyeEdge) -> Recording:
    """Return the line with some edges lost."""
    return replace(recording, edges=tuple(edge for edge in recording.edges if edge not in lost))


def without_block_at(recording: Recording, stamp: int) -> Recording:
    """Return the line with the block around a time lost."""
    last = max(block.stamp for block in recording.blocks if block.stamp <= stamp)
    return replace(
        recording, blocks=tuple(block for block in recording.blocks if block.stamp != last)
    )


def saturated_at(recording: Recording, stamp: int) -> Recording:
    """Return the line with the converter at its limit around a time."""
    last = max(block.stamp for block in recording.blocks if block.stamp <= stamp)
    limit = recording.load_cell.max_counts
    return replace(
        recording,
        blocks=tuple(
            replace(block, counts=np.full_like(block.counts, limit))
            if block.stamp == last
            else block
            for block in recording.blocks
        ),
    )
