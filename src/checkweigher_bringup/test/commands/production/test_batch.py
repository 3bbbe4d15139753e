# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command batch as a user runs it: on a bag, on its CSV, and on what it cannot use."""

import json
from pathlib import Path

from running import BAGS, ROOT, run_command

RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'


def test_a_bag_and_its_csv_are_the_same_batch(tmp_path: Path):
    bag, masses = BAGS / 'paper_60', tmp_path / 'masses.csv'
    html, from_bag, from_csv = (tmp_path / name for name in ('b.html', 'b.json', 'c.json'))
    assert run_command('weigh', bag, '--csv', masses).returncode == 0
    of_bag = run_command('batch', bag, '--nominal', 130, '--html', html, '--json', from_bag)
    of_csv = run_command('batch', masses, '--nominal', 130, '--json', from_csv)
    assert (of_bag.returncode, of_csv.returncode) == (0, 0), of_bag.stderr + of_csv.stderr
    assert 'batch paper_60, batch: 25 items: 25 ACCEPT' in of_bag.stdout
    assert 'reference test: ' in of_bag.stdout
    assert of_bag.stdout.splitlines()[1:] == of_csv.stdout.splitlines()[1:]
    ours, theirs = (json.loads(path.read_text()) for path in (from_bag, from_csv))
    # 25 items: 5 each of 74.5 g to 254.5 g; TU1 of 130 g is 124.15 g.
    assert ours['products'][0]['rules']['below_tu1'] == 5
    assert ours['products'][0]['decisions'] == theirs['products'][0]['decisions']
    assert html.read_text().count('<svg') == 2


def test_what_is_no_batch_is_one_line_and_status_2(tmp_path: Path):
    record = tmp_path / 'L1.jsonl'
    record.write_text('{"kind":"verdict"}\n')
    bag = BAGS / 'paper_60'
    for arguments, complaint in (
        ((bag,), 'which product? Give --nominal, or --recipes and --product'),
        ((bag, '--recipes', RECIPES), '--recipes and --product belong together'),
        ((record,), 'L1.jsonl:1: is no line of the record of a batch'),
        ((record, '--nominal', 100), '--nominal: the record of a batch has its product'),
    ):
        found = run_command('batch', *arguments)
        assert (found.returncode, found.stdout) == (2, '')
        assert complaint in found.stderr
        assert found.stderr.count('\n') == 1
