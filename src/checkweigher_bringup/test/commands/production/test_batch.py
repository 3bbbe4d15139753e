# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command batch as a user runs it: on a bag, on its CSV, and on what it cannot use."""

from dataclasses import asdict
import json
from pathlib import Path

from here import refused, run_here
from running import BAGS, ROOT

from checkweigher_core.records import Decision, Verdict
from checkweigher_core.settings_files import settings_of
from checkweigher_production.audit_log import AuditLog
from checkweigher_production.batch_record import RecordWriter
from checkweigher_production.recipes import Product

RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'


def test_a_bag_and_its_csv_are_the_same_batch(tmp_path: Path):
    bag, masses = BAGS / 'paper_60', tmp_path / 'masses.csv'
    html, from_bag, from_csv = (tmp_path / name for name in ('b.html', 'b.json', 'c.json'))
    assert run_here('weigh', bag, '--csv', masses).returncode == 0
    of_bag = run_here('batch', bag, '--nominal', 130, '--html', html, '--json', from_bag)
    of_csv = run_here('batch', masses, '--nominal', 130, '--json', from_csv)
    assert (of_bag.returncode, of_csv.returncode) == (0, 0), of_bag.stderr + of_csv.stderr
    assert 'batch paper_60, batch: 25 items: 25 ACCEPT' in of_bag.stdout
    assert '\n  reference test, double sampling: ' in of_bag.stdout
    assert of_bag.stdout.splitlines()[1:] == of_csv.stdout.splitlines()[1:]
    ours, theirs = (json.loads(path.read_text()) for path in (from_bag, from_csv))
    # 25 items: 5 each of 74.5 g to 254.5 g; TU1 of 130 g is 124.15 g.
    assert ours['products'][0]['rules']['below_tu1'] == 5
    assert ours['products'][0]['decisions'] == theirs['products'][0]['decisions']
    assert html.read_text().count('<svg') == 2


def test_a_record_that_was_changed_differs_from_the_audit_log(tmp_path: Path):
    log = tmp_path / 'audit.log'
    writer = RecordWriter(tmp_path)
    writer.begin('L1', '2026-05-28T06:00:00', audit_log=str(log))
    writer.write('product', asdict(settings_of(Product, {'nominal': 0.1}, 'tins')))
    for number in (1, 2):
        writer.write(
            'verdict',
            Verdict(number, number, Decision.ACCEPT, mass=0.1, product='tins', batch='L1'),
        )
    writer.end('2026-05-28T07:00:00')
    ended = writer.ended.get(timeout=60)
    writer.close()
    with AuditLog(log) as audit:
        audit.append('2026-05-28T05:00:00', '/product', 'selection', 'product', None, 'tins')
        status, said, made = report(Path(ended.record), tmp_path / '1.json')
        assert (status, made) == (0, 'not in the log')
        assert 'is not in the audit log' in said
        audit.append('2026-05-28T07:00:01', '/product', 'record', 'L1', None, ended.sha256)
    status, said, made = report(Path(ended.record), tmp_path / '2.json')
    assert (status, made) == (0, 'agrees')
    assert 'agrees with the audit log' in said

    lines = Path(ended.record).read_text().splitlines(keepends=True)
    Path(ended.record).write_text(''.join([*lines[:3], *lines[4:]]))  # an item less
    status, said, made = report(Path(ended.record), tmp_path / '3.json')
    assert (status, made) == (1, 'differs')
    assert 'DIFFERS' in said
    assert '1 items: 1 ACCEPT' in said


def report(record: Path, output: Path) -> tuple[int, str, str]:
    found = run_here('batch', record, '--json', output)
    assert found.stderr == ''
    return found.returncode, found.stdout, json.loads(output.read_text())['sha256_in_audit_log']


def test_one_item_at_its_nominal_weight_has_plain_numbers(tmp_path: Path):
    masses = tmp_path / 'masses.csv'
    masses.write_text('item_id,t3,mass_g,decision,reasons\n1,1.0,99.9999,ACCEPT,\n')
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
        ((bag, '--recipes', RECIPES), '--recipes and --product belong together'),
        ((record,), 'L1.jsonl:1: is no line of the record of a batch'),
        (
            (bag, '--nominal', 130, '--html', record.parent / 'b', '--json', same),
            '--html and --json: both are',
        ),
        ((record, '--nominal', 100), '--nominal: the record of a batch has its product'),
    ):
        assert complaint in refused('batch', *arguments)
