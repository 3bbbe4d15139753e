# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches across restarts: what goes on, and that damage or doubt waits for a person."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
import json
import os
from pathlib import Path
import random
import shutil

import pytest

from checkweigher_core.records import Decision, FillerFeedback, Verdict
from checkweigher_core.settings_files import settings_of
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_production.audit_log import AuditLog, read_log
from checkweigher_production.batch_record import RecordState, read_events
from checkweigher_production.nodes.batch_recorder import LineBatches
from checkweigher_production.recipes import Product
from checkweigher_production.selection import FILE

TINS = settings_of(
    Product, {'nominal': 0.1, 'tu1_quota': 0.025, 'filler': {'max_correction': 0.003}}, 'tins'
)
LIMITS = replace(TINS.on_line('L2'), lower_limit=0.092)  # as somebody has set it
COUNT = 12
RECORDS = Path(__file__).with_name('records')  # as written by each earlier version
Change = Callable[[Path, random.Random], object]


@contextmanager
def batches(
    folder: Path, log: AuditLog | None = None, note: Callable[[RecordState], object] = str
) -> Iterator[LineBatches]:
    made = LineBatches('', str(folder), lambda: 'noon', log)
    made.open(note)
    yield made
    made.close()


def verdict(number: int, batch: str) -> Verdict:
    return Verdict(
        number, number, Decision.ACCEPT, mass=0.0951, product='tins', batch=batch,
        batch_items=number, batch_accepted=number, batch_below_tu1=number, batch_surplus=-0.001,
    )  # fmt: skip


@pytest.fixture(name='folder', scope='module')
def _folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a line that was killed in the batch L2, after L1."""
    folder = tmp_path_factory.mktemp('machine') / 'batches'
    with batches(folder) as line:
        line.use(TINS)
        for batch in ('L1', 'L2'):
            line.production.batch = batch
            line.begin()
            for number in range(1, COUNT + 1):
                line.add(verdict(number, batch))
        line.write('filler', FillerFeedback(1, 'tins', 1, 10, 0.1, 0.099, 0.001, 0.001))
        line.keep(LIMITS, always=True)
    return folder


@pytest.fixture(name='copy')
def _copy(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / 'batches'))


def goes_on(line: LineBatches) -> bool:
    """Return whether a product is on the line; its limits and batch must be those of before."""
    if line.selected is None:
        assert line.in_doubt or line.production.product is None
        return False
    assert (line.selected.product, line.selected.on_line) == (TINS, LIMITS)
    assert (line.production.batch, line.production.product) == ('L2', TINS)
    return True


def test_a_line_goes_on_with_product_limits_batch_and_counts(copy: Path):
    for _ in range(2):
        with batches(copy) as line:
            assert goes_on(line)
            assert line.production.tally('tins', 'L2') == BatchTally.of(verdict(COUNT, 'L2'))
            assert line.production.summary().accepted == COUNT
            assert not line.add(verdict(COUNT, 'L2'))  # which comes again
    assert line.finding().level == 0


@pytest.mark.parametrize('path', sorted(RECORDS.iterdir()), ids=lambda path: path.stem)
def test_a_batch_that_an_older_version_began_goes_on(path: Path, tmp_path: Path):
    shutil.copyfile(path, tmp_path / 'L1.jsonl')
    with batches(tmp_path) as line:
        assert (line.doubt, line.production.batch) == ('', 'L1')
        assert line.production.tally('tins', 'L1') == BatchTally('tins', 'L1', 3, 2, 0, 0.0)
        line.use(TINS)
        assert line.add(verdict(4, 'L1'))
        line.begin()
    kinds = [kind for kind, _ in read_events(tmp_path / 'L1.jsonl')]
    assert kinds[:7] == ['begin', 'product', *3 * ['verdict'], 'stop', 'filler']


def test_of_several_batches_in_progress_none_is_chosen_by_a_guess(copy: Path):
    (copy / FILE).unlink()
    with batches(copy) as line:  # from an older version: one in progress, whatever its time
        assert (line.doubt, line.production.batch, line.selected) == ('', 'L2', None)
    lines = (copy / 'L1.jsonl').read_text().splitlines(keepends=True)
    (copy / 'L1.jsonl').write_text(''.join(lines[:-1]))
    with batches(copy) as line:
        assert 'L1.jsonl' in line.doubt
        assert 'L2.jsonl' in line.doubt
        assert line.in_doubt
        assert line.may_begin('L1')
        line.production.batch = 'L1'
        line.begin()
        assert line.production.tally('tins', 'L1').items == COUNT
        line.keep(None, always=True)
    with batches(copy) as line:
        assert (line.doubt, line.production.batch) == ('', 'L1')
        assert 'L2.jsonl: has begun and not ended' in line.finding().text


def test_a_change_of_the_batch_that_was_interrupted_is_finished(copy: Path):
    with batches(copy) as line:
        line.production.batch = 'L3'
        line.keep(LIMITS)
        line.begin()
    (copy / 'L3.jsonl').unlink()
    ended = (copy / 'L2.jsonl').read_text().splitlines(keepends=True)
    (copy / 'L2.jsonl').write_text(''.join(ended[:-1]))
    with batches(copy) as line:
        assert (line.doubt, line.production.batch) == ('', 'L3')
    assert (copy / 'L2.jsonl').read_text().splitlines()[-1].startswith('{"kind":"end"')
    noted: list[RecordState] = []
    with batches(copy, note=noted.append):
        pass
    assert (noted[0].batch, noted[0].event) == ('L2', 'ended')
    (copy / 'L3.jsonl').unlink()  # by somebody
    with batches(copy) as line:
        assert 'L3.jsonl: the batch was in progress, and its counts are lost' in line.doubt


def test_a_selection_that_the_audit_log_has_gone_beyond_is_none(copy: Path):
    with AuditLog(copy / 'audit.log') as log:
        with batches(copy, log) as line:
            log.append('noon', 'product', 'selection', 'product', None, {})
            line.keep(LIMITS, always=True)
            log.append('noon', 'product', 'zero', 'zero', None, {})
        with AuditLog(copy / 'other.log'), batches(copy, log) as line:
            assert goes_on(line)
        log.append('noon', 'product', 'batch', 'statistics', None, 'L4')
    with AuditLog(copy / 'audit.log') as log, batches(copy, log) as line:
        assert (line.selected, line.production.batch) == (None, 'L2')
        assert 'the audit log has a later selection' in line.finding().text


def _line_of(path: Path, draw: random.Random) -> tuple[list[bytes], int]:
    lines = path.read_bytes().splitlines(keepends=True)
    return lines, draw.randrange(len(lines))


def flip(path: Path, draw: random.Random) -> None:
    data = bytearray(path.read_bytes())
    data[draw.randrange(len(data))] ^= draw.randrange(1, 256)
    path.write_bytes(data)


def drop_line(path: Path, draw: random.Random) -> None:
    lines, number = _line_of(path, draw)
    path.write_bytes(b''.join(lines[:number] + lines[number + 1 :]))


def move_line(path: Path, draw: random.Random) -> None:
    lines, number = _line_of(path, draw)
    lines.insert(draw.randrange(len(lines) + 1), lines[number])
    path.write_bytes(b''.join(lines))


def change_field(path: Path, draw: random.Random) -> None:
    """Remove a field or give it another type, with its hash or as older versions wrote."""
    lines, number = _line_of(path, draw)
    values = json.loads(lines[number])
    name = draw.choice(list(values))
    values[name] = draw.choice([None, [], {}, [1], 'text', 10**400, True, {'a': [None]}])
    if draw.random() < 0.5:
        del values[name]
    if draw.random() < 0.5:
        values.pop('hash', None)
    lines[number] = json.dumps(values, separators=(',', ':')).encode() + b'\n'
    path.write_bytes(b''.join(lines))


def link(path: Path, _: random.Random) -> None:
    path.unlink()
    path.symlink_to('nowhere')


CHANGES: dict[str, Change] = {
    'flip': flip,
    'cut': lambda path, draw: os.truncate(path, draw.randrange(path.stat().st_size)),
    'empty': lambda path, _: path.write_bytes(b''),
    'drop line': drop_line,
    'move line': move_line,
    'change field': change_field,
    'nest': lambda path, _: path.write_bytes(b'[' * 16_000),
    'link': link,
    'remove': lambda path, _: path.unlink(),
}


@pytest.mark.parametrize('count', [20, pytest.param(20_000, marks=pytest.mark.soak)])
def test_no_damage_to_a_file_is_taken_for_the_state_of_the_line(
    folder: Path, tmp_path: Path, count: int
):
    draw, went_on, broken = random.Random(count), 0, 0
    known = [BatchTally('tins', 'L2'), *(BatchTally.of(verdict(n + 1, 'L2')) for n in range(COUNT))]
    for number in range(count):
        copy = Path(shutil.copytree(folder, tmp_path / str(number)))
        path = copy / draw.choice([FILE, 'L1.jsonl', 'L2.jsonl', 'L2.jsonl'])
        change = draw.choice(list(CHANGES))
        CHANGES[change](path, draw)
        before = f'{number}: {change} {path.name}'
        with batches(copy) as line:
            assert not line.finding().text.count('\n'), before
            went = goes_on(line)
            tally = line.production.tally('tins', 'L2')
            line.production.product = None
            line.production.batch = 'L9'
            line.begin()
            assert not line.doubt, before
        assert [*line.states()], before
        went_on += went
        if went and line.broken and path.name == 'L2.jsonl':
            broken += 1  # `sign` refuses a broken record with any counts
        elif went:
            # Whole lines at the end may be missing, as after a power cut.
            assert tally in (known if path.name == 'L2.jsonl' else known[-1:]), before
            assert tally == known[-1] or change in ('cut', 'drop line'), before
        shutil.rmtree(copy)
    print(f'{count} changes, {went_on} after which the line went on, {broken} with a broken batch')


def test_a_line_that_is_killed_as_soon_as_it_has_started_again_does_not_break_the_record(
    copy: Path, tmp_path: Path
):
    def start(log: AuditLog, end: str) -> LineBatches:
        line = LineBatches('', str(copy), lambda: 'noon', log)

        def note(state: RecordState) -> None:
            if state.event == 'continued':  # before any line is added
                assert (copy / 'L2.jsonl').stat().st_size == state.size
            log.append('noon', '/product', 'record', state.batch, None, state.value)

        line.open(note)
        if end == 'stopped':
            line.close()
            for state in line.states():
                note(state)
        else:  # killed: what is written stays, and the log gets no other entry
            line._writer.settle(10.0)
        return line

    kept = []  # a line that was collected would close its record
    for end in ('stopped', 'killed', 'stopped'):
        with AuditLog(tmp_path / 'audit.log') as log:
            kept.append(start(log, end))
        assert kept[-1].broken == ''
        assert kept[-1].selected is not None
    entries = read_log(tmp_path / 'audit.log').entries
    events = [each.new['event'] for each in entries if each.subject == 'L2']
    assert events == ['continued', 'stopped', 'continued', 'continued', 'stopped']
