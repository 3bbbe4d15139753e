# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder of a machine with the record, the report and the audit log of a batch."""

from dataclasses import asdict
from pathlib import Path

from checkweigher_bringup.batch_reporter import write_files
from checkweigher_core.records import Decision, Verdict
from checkweigher_core.settings_files import settings_of
from checkweigher_dsp.rejection.batch_rules import BatchTally, count
from checkweigher_production.audit_log import AuditLog
from checkweigher_production.batch_record import RecordWriter
from checkweigher_production.recipes import Product


def write_machine(folder: Path) -> tuple[Path, Path]:
    """Write the record and the audit log of a batch as a line does; return their paths."""
    log, values = folder / 'audit.log', {'nominal': 0.1, 'release_by': 2}
    tins = settings_of(Product, values, 'tins')
    folder.mkdir()
    with AuditLog(log) as audit:
        audit.append('2026-05-28T05:00:00', '/product', 'selection', 'product', None, 'tins')
        writer = RecordWriter(folder / 'batches')
        writer.begin('L1', '2026-05-28T06:00:00', audit_log=str(log), audit_hash=audit.last_hash)
        writer.write('product', asdict(tins))
        tally = BatchTally('tins', 'L1')
        for number in (1, 2):
            tally = count(0.1, tally, tins.on_line('L1'), accepted=True)
            of_batch = {'product': 'tins', 'batch': 'L1', **tally.counts}
            writer.write('verdict', Verdict(number, 1, Decision.ACCEPT, mass=0.1, **of_batch))
        writer.end('2026-05-28T07:00:00')
        writer.close()
        while not writer.states.empty():
            value = writer.states.get().value
            audit.append('2026-05-28T07:00:01', '/product', 'record', 'L1', None, value)
        record = folder / 'batches/L1.jsonl'
        files = write_files(record, value['sha256'])
        audit.append('2026-05-28T07:00:02', '/product', 'report', 'L1', None, files)
    return record, log
