# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `batch` on a bag, a CSV file, a record, and files that it cannot use."""

import json
from pathlib import Path

from here import refused, run_here
from made_machine import write_machine
from running import BAGS, ROOT

RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'


def test_a_bag_and_its_csv_are_the_same_batch(tmp_path: Path):
    bag, masses = BAGS / 'paper_60', tmp_path / 'masses.csv'
    html, from_bag, from_csv = (tmp_path / name for name in ('b.html', 'b.json', 'c.json'))
    assert run_here('weigh', bag, '--csv', masses).returncode == 0
    of_bag = run_here('batch', bag, '--nominal', 130, '--html', html, '--json', from_bag)
    of_csv = run_here('batch', masses, '--nominal', 130, '--json', from_csv)
    # A batch of five masses meets no rule.
    assert (of_bag.returncode, of_csv.returncode) == (1, 1), of_bag.stderr + of_csv.stderr
    assert 'batch paper_60, batch: 25 items: 25 ACCEPT' in of_bag.stdout
    assert '\n  reference test, double sampling: ' in of_bag.stdout
    assert of_bag.stdout.splitlines()[1:] == of_csv.stdout.splitlines()[1:]
    ours, theirs = (json.loads(path.read_text()) for path in (from_bag, from_csv))
    # 25 items: 5 each of 74.5 g to 254.5 g; TU1 of 130 g is 124.15 g.
    assert ours['products'][0]['rules']['below_tu1'] == 5
    assert ours['products'][0]['decisions'] == theirs['products'][0]['decisions']
    assert html.read_text().count('<svg') == 2


def test_a_record_is_trusted_as_far_as_the_log_of_the_machine_vouches_for_it(tmp_path: Path):
    record, log = write_machine(tmp_path / 'machine')
    said = report(record, 0)
    assert 'agrees with the audit log audit.log, 4 entries, the last one has the hash ' in said
    elsewhere = tmp_path / 'elsewhere' / 'L1.jsonl'
    elsewhere.parent.mkdir()
    elsewhere.write_bytes(record.read_bytes())
    assert 'there is no audit log to compare the record with' in report(elsewhere, 1)
    assert report(elsewhere, 0, '--log', log) == said
    pages = []
    for path in (record, elsewhere):
        html, numbers = path.with_suffix('.html'), path.with_suffix('.json')
        report(path, 0, '--log', log, '--html', html, '--json', numbers, '--overwrite')
        pages.append((html.read_bytes(), numbers.read_bytes()))
    assert pages[0] == pages[1]

    # A log of the forger, which the record names, is not the log of the machine.
    forged, own = write_machine(tmp_path / 'forger')
    forged.write_text(forged.read_text().replace('"ACCEPT"', '"UNDER"'))
    (tmp_path / 'machine/batches/L1.jsonl').write_bytes(forged.read_bytes())
    assert 'does NOT agree' in report(record, 1)
    assert 'line 3: it or a line before it is not as it was' in report(record, 1, '--log', own)
    record.write_bytes(elsewhere.read_bytes())
    log.write_bytes(log.read_bytes().replace(b'tins', b'tons'))
    assert 'the audit log audit.log is not whole: line 1: changed' in report(record, 1)
    assert 'No such file' in refused('batch', record, '--log', tmp_path / 'nothing')


def test_a_batch_that_does_not_meet_a_rule_has_status_1(tmp_path: Path):
    masses = tmp_path / 'masses.csv'
    masses.write_text('item_id,t3,mass_g,decision,reasons\n1,1.0,99,ACCEPT,\n')
    assert 'mean NOT met' in report(masses, 1, '--nominal', 100)


def report(record: Path, status: int, *options: object) -> str:
    found = run_here('batch', record, *options)
    assert (found.returncode, found.stderr) == (status, ''), found.stdout
    return found.stdout


def test_one_item_at_its_nominal_weight_has_plain_numbers(tmp_path: Path):
    masses = tmp_path / 'masses.csv'
    masses.write_text('item_id,t3,mass_g,decision,reasons\n1,1.0,100.0001,ACCEPT,\n')
    found = run_here('batch', masses, '--nominal', 100)
    assert found.returncode == 0, found.stderr
    assert found.stdout.splitlines()[1] == '  mean 100.000 g of 100 g, giveaway +0.000 g'


def test_what_is_no_batch_is_one_line_and_status_2(tmp_path: Path):
    record = tmp_path / 'L1.jsonl'
    record.write_text('{"kind":"verdict"}\n')
    bag = BAGS / 'paper_60'
    same = tmp_path / '..' / tmp_path.name / 'b'
    for arguments, complaint in (
        ((bag,), 'which product? Give --nominal, or --recipes and --product'),
        ((bag, '--recipes', RECIPES), '--recipes and --product must be given together'),
        ((record,), 'L1.jsonl:1: is no line of the record of a batch'),
        (
            (bag, '--nominal', 130, '--html', record.parent / 'b', '--json', same),
            '--html and --json: both are',
        ),
        ((record, '--nominal', 100), '--nominal: not with a record of a batch'),
    ):
        assert complaint in refused('batch', *arguments)
