# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Masses do not depend on the blocks of samples, the gain of the load cell, or its clock."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from lines import amplified, reblocked, simulated, write_line
import pytest
from running import Rows

from checkweigher_core.recording import Recording

Weigh = Callable[[Recording], list[dict[str, str]]]

GAIN_TOLERANCE = 1e-9  # relative
DRIFT = 1e-4  # of the clock of a load cell; of quartz


@pytest.fixture
def weigh(rows: Rows, tmp_path: Path) -> Weigh:
    def run(line: Recording) -> list[dict[str, str]]:
        return rows('weigh', write_line(tmp_path / f'bag{len(list(tmp_path.iterdir()))}', line))

    return run


@pytest.mark.parametrize('sizes', [[1], [7, 1, 64], [960], [100_000]])
def test_blocks_of_any_size_give_the_same_rows(weigh: Weigh, sizes: list[int]):
    line = simulated(speed=1.25, count=6, profile='roller')
    assert weigh(reblocked(line, sizes)) == weigh(line)


@pytest.mark.parametrize('gain', [-1, 3, 100])
def test_the_gain_of_the_load_cell_changes_no_mass(weigh: Weigh, gain: int):
    line = simulated(speed=1.5, count=10)
    for row, amplified_row in zip(weigh(line), weigh(amplified(line, gain)), strict=True):
        mass = float(row['mass_g'])
        assert float(amplified_row['mass_g']) == pytest.approx(mass, rel=GAIN_TOLERANCE)


@pytest.mark.parametrize('drift', [DRIFT, -DRIFT])
@pytest.mark.parametrize('speed', [1.0, 1.5])
def test_a_clock_that_is_off_changes_no_mass_by_more_than_a_count(
    weigh: Weigh, speed: float, drift: float
):
    line = simulated(speed=speed, count=10)
    begin, count = line.blocks[0].stamp, 1e3 / line.load_cell.counts_per_kg
    stretched = Recording.from_events(
        line.load_cell,
        [replace(event, stamp=begin + round((event.stamp - begin) * (1 + drift)))
         for event in line],
    )  # fmt: skip
    for row, other in zip(weigh(line), weigh(stretched), strict=True):
        assert float(other['mass_g']) == pytest.approx(float(row['mass_g']), abs=count)
