# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The alarms of a lane: their times and counts, and what a restart, a kill and a person change."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from full_disk import file_size_limit
import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.records import NANOSECONDS, Alarms, Decision, StopRequest, Verdict
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_production.alarms import AlarmList
from checkweigher_production.audit_log import AuditLog, read_log
from checkweigher_production.audit_trail import AuditTrail, Author

ANNA = Author('anna', 'seen')
STOP = StopRequest(StopReason.BIN_FULL, 0, text='bin 2')
FAULT = Verdict(1, 0, Decision.FAULT, ('BadSignal',))


class Lane:
    """The alarms of one run of a line, with a clock of whole seconds."""

    def __init__(self, log: AuditLog) -> None:
        self.now = 0
        self.sent: list[Alarms] = []
        trail = AuditTrail(log, '/product', lambda: f'{self.now:05}')
        self.list = AlarmList(trail, lambda: self.now * NANOSECONDS, self.sent.append)
        self.list.begin_run()

    def shown(self) -> list[tuple[object, ...]]:
        return [
            (a.source, a.reason, a.first // NANOSECONDS, a.last // NANOSECONDS, a.count, a.active)
            for a in self.sent[-1].alarms
        ]


@contextmanager
def run(path: Path, *, killed: bool = False) -> Iterator[Lane]:
    with AuditLog(path) as log:
        yield (lane := Lane(log))
        if not killed:
            lane.list.end_run()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / 'audit.log'


def test_a_stop_lasts_until_it_is_taken_back_and_stays_until_it_is_acknowledged(path: Path):
    with run(path) as lane:
        for lane.now, request in ((3, STOP), (4, STOP), (8, None), (20, STOP), (21, None)):
            lane.list.set_stop(request)
        assert lane.shown() == [('stop', 'BinFull', 3, 21, 2, False)]
        assert lane.sent[-1].alarms[0].duration == 6.0
        assert lane.sent[-1].alarms[0].text.endswith('bin 2')
        assert lane.list.finding().level == Level.WARN
        assert lane.list.acknowledge(ANNA) == '1 alarm acknowledged'
        assert (lane.shown(), lane.list.finding().level) == ([], Level.OK)
    entries = [each for each in read_log(path).entries if each.kind == 'alarm']
    assert [(e.new['count'], e.new['active']) for e in entries] == [
        (1, True), (1, False), (2, True), (2, False), (2, False),
    ]  # fmt: skip
    assert (entries[-1].who, entries[-1].why) == ANNA


def test_another_stop_ends_the_first_and_one_that_lasts_is_no_less_there_for_being_known(
    path: Path,
):
    with run(path) as lane:
        lane.list.set_stop(STOP)
        lane.list.set_stop(replace(STOP, reason=StopReason.GUARD_OPEN))
        lane.list.acknowledge(ANNA)
        assert lane.shown() == [('stop', 'GuardOpen', 0, 0, 1, True)]
        lane.list.set_stop(replace(STOP, reason=StopReason.NOT_READY))
        assert lane.shown() == []


def test_a_restart_and_a_kill_keep_the_alarms_and_a_kill_is_one_itself(path: Path):
    with run(path) as lane:
        for lane.now in range(1, 6):
            lane.list.add_verdict(FAULT)
    with run(path, killed=True) as lane:
        assert lane.shown() == [('fault', 'BadSignal', 1, 5, 5, False)]
        for lane.now in (7, 8, 9, 10, 11):
            lane.list.add_verdict(FAULT)
    with run(path) as lane:
        # The entry at the eighth fault was the last one.
        assert lane.shown() == [
            ('fault', 'BadSignal', 1, 9, 8, False),
            ('node', 'product', 0, 0, 1, False),
        ]
    with run(path) as lane:
        assert len(lane.shown()) == 2


def test_only_a_second_start_of_a_node_of_the_line_is_an_alarm(path: Path):
    with run(path) as lane:
        for nodes in ({'driver', 'segmenter', 'status'}, {'status'}, {'segmenter'}, {'segmenter'}):
            lane.list.add_started(nodes)
        assert lane.shown() == [('node', 'segmenter', 0, 0, 2, False)]


@pytest.mark.parametrize(
    'verdict',
    [
        replace(FAULT, decision=Decision.UNDER, reasons=()),
        replace(FAULT, reasons=('BadSignal', Reason.PERFORMANCE_TEST.value)),
    ],
)
def test_rejects_for_their_mass_and_test_products_are_none(path: Path, verdict: Verdict):
    with run(path) as lane:
        lane.list.add_verdict(verdict)
        assert lane.shown() == []


def test_ten_thousand_faults_leave_few_entries(path: Path):
    with run(path) as lane:
        for lane.now in range(10_000):
            lane.list.add_verdict(replace(FAULT, reasons=('OfAnotherVersion',)))
        assert lane.shown() == [('fault', 'OfAnotherVersion', 0, 9999, 10_000, False)]
    assert len(read_log(path).entries) < 20


def test_alarms_on_a_full_disk_are_shown_and_written_later(path: Path):
    with run(path) as lane:
        with file_size_limit(path.stat().st_size + 10):
            lane.list.set_stop(STOP)
            assert lane.shown() == [('stop', 'BinFull', 0, 0, 1, True)]
        lane.list.set_stop(None)
    assert [e.kind for e in read_log(path).entries] == ['run', 'alarm', 'alarm', 'run']
