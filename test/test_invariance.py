"""What must not change a mass: how samples were grouped into messages, and the gain of the cell."""

from collections.abc import Callable
from pathlib import Path

from lines import amplified, reblocked, simulated
import pytest

from checkweigher_driver.bag_writing import write_bag
from checkweigher_driver.recording import Recording

Rows = Callable[..., list[dict[str, str]]]

GAIN_TOLERANCE = 1e-9  # relative


@pytest.fixture
def weigh(rows: Rows, tmp_path: Path) -> Callable[[Recording], list[dict[str, str]]]:
    def run(line: Recording) -> list[dict[str, str]]:
        path = tmp_path / f'bag{len(list(tmp_path.iterdir()))}'
        write_bag(path, line.load_cell, line)
        return rows('weigh', path)

    return run


@pytest.mark.parametrize('sizes', [[1], [7, 1, 64], [960], [100_000]])
def test_blocks_of_any_size_give_the_same_rows(
    weigh: Callable[[Recording], list[dict[str, str]]], sizes: list[int]
):
    line = simulated(speed=1.25, count=6, profile='roller')
    assert weigh(reblocked(line, sizes)) == weigh(line)


@pytest.mark.parametrize('gain', [-1, 3, 100])
def test_the_gain_of_the_load_cell_changes_no_mass(
    weigh: Callable[[Recording], list[dict[str, str]]], gain: int
):
    line = simulated(speed=1.5, count=10)
    for row, amplified_row in zip(weigh(line), weigh(amplified(line, gain)), strict=True):
        mass = float(row['mass_g'])
        assert float(amplified_row['mass_g']) == pytest.approx(mass, rel=GAIN_TOLERANCE)
