# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags of the steps of a verification, of a simulated machine."""

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
import zlib

from lines import simulated, write_line
import numpy as np

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, LoadCell, SampleBlock
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters
from checkweigher_validation.verification.plan import read_plan
from checkweigher_validation.verification.steps import Step, steps_of

START, _PAUSE = 1_780_000_000, 5  # s
_SAMPLES, _BLOCK, _NOISE = 2880, 48, 1e-5  # at rest; kg


def record_steps(
    folder: Path, plan: str, names: Collection[str] = (), *, gain: float = 1.0, drift: float = 0.0
) -> list[Path]:
    """Write a bag of each step of a plan, or of those of some names, in the order of the plan.

    The machine shows `gain` times a load, and each step the zero of it `drift` kg higher.
    """
    bags = []
    folder.mkdir()
    begin = START
    for number, step in enumerate(steps_of(read_plan(plan))):
        if names and step.name not in names:
            continue
        begin = max(begin, START + round(60 * (step.minutes or 0)))
        make = _at_rest if step.at_rest else _passes
        recording = make(step, begin, gain, number * drift)
        bags.append(write_line(folder / step.name, recording))
        begin = recording.blocks[-1].stamp // NANOSECONDS + _PAUSE
    return bags


def _cell(made: LoadCell, gain: float) -> LoadCell:
    """Return a cell that shows more than is there: its sensitivity is stated too low."""
    return replace(made, counts_per_kg=made.counts_per_kg / gain, serial_number='S-1')


def _passes(step: Step, begin: int, gain: float, zero: float) -> Recording:
    assert step.load is not None
    made = simulated(
        speed=step.speed, masses=(step.load.mass,), count=step.count,
        seed=zlib.crc32(step.name.encode()), start_time=begin,
    )  # fmt: skip
    cell = _cell(made.load_cell, gain)
    higher = round(zero * cell.counts_per_kg)
    blocks = tuple(replace(block, counts=block.counts + higher) for block in made.blocks)
    return replace(made, load_cell=cell, blocks=blocks)


def _at_rest(step: Step, begin: int, gain: float, zero: float) -> Recording:
    cell = _cell(Simulation(SimulationParameters()).load_cell, gain)
    mass = gain * step.load.mass if step.load else 0.0
    random = np.random.default_rng(zlib.crc32(step.name.encode()))
    masses = mass + zero + _NOISE * random.standard_normal(_SAMPLES)
    counts = np.rint(cell.zero_counts + cell.counts_per_kg * masses).astype(np.int32)
    blocks = [
        SampleBlock(
            begin * NANOSECONDS + round(first * NANOSECONDS / cell.sample_rate), first,
            counts[first : first + _BLOCK],
        )
        for first in range(0, _SAMPLES, _BLOCK)
    ]  # fmt: skip
    return Recording(cell, tuple(blocks), ())
