# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `keep`."""

from pathlib import Path

from here import refused, run_here
from running import BAGS, read_rows


def row_of(bag: Path, item: int, table: Path) -> dict[str, str]:
    """Return the row of an item in the output of `weigh`."""
    assert run_here('weigh', bag, '--csv', table).returncode == 0
    return next(row for row in read_rows(table) if row['item_id'] == str(item))


def test_an_item_becomes_a_small_bag_with_its_verdict(tmp_path: Path):
    small = tmp_path / 'item17'
    done = run_here('keep', BAGS / 'paper_60', '--item', 17, '--output', small)
    assert (done.returncode, done.stderr) == (0, '')
    number = int(done.stdout.split()[-4])
    assert done.stdout.splitlines()[-1].endswith(f'is item {number} of this bag')
    whole = row_of(BAGS / 'paper_60', 17, tmp_path / 'whole.csv')
    kept = row_of(small, number, tmp_path / 'kept.csv')
    for name in ('t1', 't2', 't3', 't4', 'decision', 'reasons', 'reference_g'):
        assert kept[name] == whole[name]
    assert abs(float(kept['mass_g']) - float(whole['mass_g'])) < 0.1 * float(whole['std_dev_g'])


def test_an_item_that_is_not_there_is_said_in_a_line(tmp_path: Path):
    said = refused('keep', BAGS / 'paper_60', '--item', 99, '--output', tmp_path / 'a')
    assert said == f'checkweigher keep: --item 99: {BAGS / "paper_60"} has items 1..25'
    assert not list(tmp_path.iterdir())
