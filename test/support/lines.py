# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recorded lines for the tests, with faults put in where a test wants them."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.recording import Recording
from checkweigher_core.records import Eye, EyeEdge, Reference, SampleBlock
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

EDGES = {
    't1': (Eye.INFEED, True),
    't2': (Eye.INFEED, False),
    't3': (Eye.OUTFEED, True),
    't4': (Eye.OUTFEED, False),
}


def simulated(**parameters: object) -> Recording:
    """Return a simulated line."""
    return simulate(SimulationParameters.from_mapping(parameters))


def write_line(path: Path, line: Recording) -> Path:
    """Write a line as a bag, and return where that is."""
    write_bag(path, line.load_cell, line)
    return path


def weigh_all(recording: Recording, parameters: LineParameters | None = None) -> Iterator[Weighing]:
    """Yield what becomes of the items of a line without the graph, in the order of verdicts."""
    events = (event for event in recording if not isinstance(event, Reference))
    line = WeighingLine(recording.load_cell, parameters or LineParameters())
    return line.weigh_all(events)


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
    return {
        name: [edge for edge in recording.edges if (edge.eye, edge.blocked) == kind][item]
        for name, kind in EDGES.items()
    }


def without_edges(recording: Recording, *lost: EyeEdge) -> Recording:
    """Return the line with some edges lost."""
    return replace(recording, edges=tuple(edge for edge in recording.edges if edge not in lost))


def _block_at(recording: Recording, stamp: int) -> SampleBlock:
    return max((each for each in recording.blocks if each.stamp <= stamp), key=lambda b: b.stamp)


def without_block_at(recording: Recording, stamp: int) -> Recording:
    """Return the line with the block around a time lost."""
    lost = _block_at(recording, stamp)
    return replace(
        recording, blocks=tuple(each for each in recording.blocks if each.stamp != lost.stamp)
    )


def saturated_at(recording: Recording, stamp: int) -> Recording:
    """Return the line with the converter at its limit around a time."""
    there = _block_at(recording, stamp)
    full = replace(there, counts=np.full_like(there.counts, recording.load_cell.max_counts))
    blocks = tuple(full if each.stamp == there.stamp else each for each in recording.blocks)
    return replace(recording, blocks=blocks)
