# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches from a record and from a CSV file, with statistics worked by hand."""

from dataclasses import asdict
import hashlib
import json
from pathlib import Path
import re

import pytest

from checkweigher_core.records import Decision, FillerFeedback, StopRequest, Verdict
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.settings_files import settings_of
from checkweigher_dsp.rejection.batch_rules import BatchTally, count
from checkweigher_production.audit_chain import LogChain
from checkweigher_production.audit_log import Entry, Verification
from checkweigher_production.batch_record import RecordError, RecordState, RecordWriter
from checkweigher_production.recipes import Product
from checkweigher_production.reference_method import SamplingPlan
from checkweigher_validation.batch.batch import BatchError, read_csv, read_record
from checkweigher_validation.batch.figures import as_json, figures_of
from checkweigher_validation.report.batch_page import render_batch

TARE = 0.004
TINS = settings_of(Product, {'nominal': 0.1, 'tare': TARE, 'tu1_quota': 0.025}, 'tins <b>')


class Line:
    """Source of the verdicts of batch L1, with the counts of the node `reject`."""

    def __init__(self) -> None:
        self._tally = BatchTally(TINS.name, 'L1')

    def verdict(self, number: int, decision: Decision, contents: float, *reasons: str) -> Verdict:
        on_line, mass = TINS.on_line('L1'), contents + TARE
        accepted = decision is Decision.ACCEPT
        self._tally = count(mass, self._tally, on_line, accepted=accepted)
        counts = {'product': TINS.name, 'batch': 'L1', **self._tally.counts}
        return Verdict(number, number * 10**9, decision, reasons, mass, **counts)


def logs_of(*entries: Entry) -> LogChain:
    return LogChain(((Path('audit.log'), Verification(entries)),))


def entry(number: int, kind: str, subject: str, new: object, time: str = '', **more: str) -> Entry:
    return Entry(number, time, '/product', kind, subject, None, new, '', f'hash {number}', **more)


def ended(number: int, subject: str, data: bytes) -> Entry:
    state = RecordState(subject, 'ended', hashlib.sha256(data).hexdigest(), len(data))
    return entry(number, 'record', subject, state.value)


@pytest.fixture
def record(tmp_path: Path) -> Path:
    """Write a batch of 120 items: 118 accepted ones of 102 g and 100 g in turn, but one of 95 g."""
    writer = RecordWriter(tmp_path)
    writer.begin('L1', '2026-01-01T10:00:00', audit_hash='hash 1')
    writer.write('product', asdict(TINS))
    verdict = Line().verdict
    for number in range(1, 119):
        contents = 0.095 if number == 7 else 0.1 + 0.002 * (number % 2)
        writer.write('verdict', verdict(number, Decision.ACCEPT, contents))
    writer.write('verdict', verdict(119, Decision.UNDER, 0.0952, 'TU1Quota'))
    writer.write('verdict', verdict(120, Decision.OVER, 0.12))
    stray = Verdict(121, 1, Decision.ACCEPT, mass=0.1, product='tins <b>', batch='L0')
    writer.write('verdict', stray)
    stop = StopRequest(StopReason.TOO_MANY_REJECTS, 120, text='<script>')
    writer.write('stop', {'time': '2026-01-01T10:30:00', **asdict(stop)})
    writer.write('filler', FillerFeedback(1, 'tins <b>', 10, 10, 0.1, 0.101, -5e-4, -5e-4))
    writer.end('2026-01-01T11:00:00')
    writer.close()
    return tmp_path / 'L1.jsonl'


def test_the_figures_of_a_record_are_those_of_its_items(record: Path):
    batch = read_record(record)
    assert (batch.name, batch.end, batch.strays) == ('L1', '2026-01-01T11:00:00', 1)
    assert batch.sha256 == hashlib.sha256(record.read_bytes()).hexdigest()
    (part,) = [figures_of(each, seed=1) for each in batch.parts]
    assert part.decisions == {'FAULT': 0, 'ACCEPT': 118, 'UNDER': 1, 'OVER': 1}
    assert part.reasons == {'TU1Quota': 1, 'OVER': 1}
    # 59 odd ones, of which the one of 95 g would have been 102 g, and 59 even ones.
    assert part.mean == pytest.approx((58 * 102 + 95 + 59 * 100) / 118 * 1e-3, rel=1e-12)
    assert part.giveaway == pytest.approx(part.mean - 0.1, rel=1e-9)
    assert part.counts.sum() == 118
    assert part.chart is not None
    assert len(part.chart.means) == 23
    assert part.judgement is not None
    assert (part.judgement.below_tu1, part.judgement.passed) == (1, True)
    assert part.reference is not None
    assert (part.reference.batch_size, part.reference.samples[0].count) == (118, 30)
    single = figures_of(batch.parts[0], 1, SamplingPlan.SINGLE).reference
    assert single is not None
    assert (single.samples[0].count, single.mean_count) == (50, 50)


def test_the_page_and_the_json_have_everything_and_nothing_of_it_is_markup(record: Path):
    alarm = {'source': 'fault', 'reason': 'NoLoad<b>', 'text': '', 'first': 0, 'last': 10**9}
    limits = [entry(number, 'parameter', 'limit', 60 * '2') for number in (1, 2, 6)]
    alarms = [entry(number, 'alarm', '', alarm | {'count': number}) for number in (3, 4)]
    back = entry(5, 'parameter', 'limit', 3, '2025-01-01', who='anna', why='<i>ripe')
    data = record.read_bytes()
    entries = [*limits[:2], *alarms, back, ended(6, 'L1', data), limits[2]]
    batch = read_record(record).with_log(logs_of(*entries), data)
    assert [(each.count, each.last) for each in batch.alarms] == [(4, 10**9)]
    # Also with a clock that was set back: the order of the log counts.
    assert [each.sequence for each in batch.changes] == [2, 5, 6]
    parts = [figures_of(each, seed=1) for each in batch.parts]
    made = json.loads(json.dumps(as_json(batch, parts), allow_nan=False))
    test = made['products'][0]['reference_test']
    assert (test['plan'], test['k']) == ('double', 0.503)
    assert made['products'][0]['control_chart']['centre'] == pytest.approx(0.101, abs=2e-4)
    assert (made['stops'][0]['reason'], made['filler'][0]['step']) == ('TooManyRejects', -5e-4)
    assert [each['sequence'] for each in made['changes']] == [2, 5, 6]
    assert [each['count'] for each in made['alarms']] == [4]
    assert (made['sha256_in_audit_log'], made['faults']) == ('agrees', [])
    assert made['audit_log'] == 'audit.log, 7 entries, the last one has the hash hash 6'
    page = render_batch(batch, parts)
    assert page == render_batch(batch, parts)
    for text in (
        'tins &lt;b&gt;',
        '&lt;script&gt;',
        batch.sha256,
        'TU1Quota',
        'parameter limit',
        60 * '2',
        'anna',
        '&lt;i&gt;ripe',
        batch.log,
        'fault NoLoad&lt;b&gt;',
        '1970-01-01T00:00:01.000000+00:00',
    ):
        assert text in page
    assert '<b>' not in page
    assert '<script' not in page
    assert page.count('<svg') == 2


def test_a_record_is_held_to_what_the_log_has_of_its_batch(record: Path):
    batch, data = read_record(record), record.read_bytes()
    assert as_json(batch, [])['sha256_in_audit_log'] is None
    assert as_json(batch, [])['products'] == []
    old = entry(1, 'record', 'L1', batch.sha256)  # as older versions wrote
    begun = entry(1, 'record', 'L1', {'event': 'begun', 'sha256': 64 * '0', 'size': 10})
    nothing = hashlib.sha256().hexdigest()
    empty = entry(1, 'record', 'L1', {'event': 'begun', 'sha256': nothing, 'size': 0})
    for entries, expected, fault in (
        ([], 'not in the log', 'the audit log does not know this batch'),
        ([ended(1, 'L2', data)], 'not in the log', 'the audit log does not know this batch'),
        ([ended(1, 'L1', data), ended(2, 'L2', b'')], 'agrees', None),
        ([old], 'agrees', None),
        ([ended(1, 'L1', data), ended(2, 'L1', data[1:])], 'differs', 'its first'),
        ([begun, ended(2, 'L1', data)], 'differs', 'its first 10 bytes are not as they were'),
        ([empty], 'differs', 'it has an end that is not in the audit log'),
    ):
        held = batch.with_log(logs_of(*entries), data)
        assert as_json(held, [])['sha256_in_audit_log'] == expected
        assert [each[: len(fault or '')] for each in held.faults] == ([fault] if fault else [])
        assert ('class="failed"' in render_batch(held, [])) == bool(fault)


def test_counts_that_are_not_those_of_the_items_are_told(tmp_path: Path, record: Path):
    for old, new, fault in (
        ('"UNDER"', '"ACCEPT"', 'line 121: item 119: its verdict counts 118 accepted'),
        (f'"mass":{0.095 + TARE}', '"mass":0.105', 'line 9: item 7: its verdict counts 1 below'),
        (
            f'"mass":{0.1 + TARE},',
            '"mass":0.105,',
            'line 4: item 2: its verdict has the surplus',
        ),
        (
            '"batch":"L1","batch_items":5',
            '"batch":"L2","batch_items":5',
            'line 8: item 6: its verd',
        ),
    ):
        path = tmp_path / 'forged' / 'L1.jsonl'
        path.parent.mkdir(exist_ok=True)
        path.write_text(record.read_text().replace(old, new, 1))
        assert fault in read_record(path).faults[0]
    renamed = record.rename(tmp_path / 'L2.jsonl')
    (fault,) = read_record(renamed).faults
    assert fault == "it is the record of batch 'L1', but has the name of another record"


def test_a_csv_is_read_as_weigh_writes_it_and_refused_with_its_line(tmp_path: Path):
    path = tmp_path / 'masses.csv'
    path.write_text(
        'item_id,t3,mass_g,decision,reasons\n'
        '1,1700000002.000000007,104.5,ACCEPT,\n2,,,FAULT,NoLoad;Saturation\n'
    )
    (part,) = read_csv(path, TINS).parts
    assert part.items[0].mass == pytest.approx(0.1005, rel=1e-12)
    assert part.items[1].reasons == ('NoLoad', 'Saturation')
    assert figures_of(part, 1).reasons == {'NoLoad': 1, 'Saturation': 1}
    for mass in ('', 'nan', 'inf'):
        without = tmp_path / 'without.csv'
        without.write_text(path.read_text() + f'3,,{mass},ACCEPT,\n')
        with pytest.raises(BatchError, match=r'without\.csv:4: is not an item: the decision is'):
            read_csv(without, TINS)
    path.write_text(path.read_text() + '3,1,x,ACCEPT,\n')
    with pytest.raises(BatchError, match=r'masses\.csv:4: is not an item'):
        read_csv(path, TINS)
    path.write_text('a,b\n')
    with pytest.raises(BatchError, match='it lacks decision, item_id, mass_g, reasons, t3'):
        read_csv(path, TINS)


@pytest.mark.parametrize(
    ('old', 'new', 'why'),
    [
        (r'"mass":[\d.]+', '"mass":NaN', 'the decision is ACCEPT, but the item has no mass'),
        ('"ACCEPT"', '"MAYBE"', '.*MAYBE'),
    ],
)
def test_a_record_with_a_bad_line_is_refused_with_its_number(record: Path, old, new, why):
    lines = record.read_text().splitlines(keepends=True)
    lines[3] = re.sub(old, new, lines[3])
    record.write_text(''.join(lines))
    with pytest.raises(RecordError, match=rf'L1\.jsonl:4: {why}'):
        read_record(record)
