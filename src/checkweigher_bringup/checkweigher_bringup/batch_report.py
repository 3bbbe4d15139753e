# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports on batches: read from the record of the line, written as HTML and JSON."""

from collections.abc import Sequence
import json
from pathlib import Path
import sys

from checkweigher_core.printable import one_line
from checkweigher_core.whole_file import write_whole
from checkweigher_production.audit_log import read_log
from checkweigher_production.batch_record import read_lines
from checkweigher_validation.batch.batch import Batch, read_record
from checkweigher_validation.batch.figures import PartFigures, as_json


def read_recorded(path: Path, log: Path | None = None) -> Batch:
    """Return the batch of a record, held to an audit log or to the one that it names.

    Raises
    ------
    RecordError, AuditError
        If the record, or the log that was given, cannot be read.
    """
    batch = read_record(path)
    named = next(read_lines(path)).get('audit_log')
    if log is None and isinstance(named, str) and Path(named).is_file():
        log = Path(named)
    if log is None:
        return batch
    found = read_log(log)
    if not found.whole:
        text = f'{log}: line {found.bad_line}: {found.problem}: {found.reason}'
        print(one_line(f'the audit log is not whole: {text}'), file=sys.stderr, flush=True)
    return batch.with_log(found.entries)


def write_report(
    batch: Batch, parts: Sequence[PartFigures], html: Path | None, json_file: Path | None
) -> None:
    """Write the files that have a path, each whole or not at all; OutputError if one cannot be."""
    if html is not None:
        from checkweigher_validation.report.batch_page import render_batch

        write_whole(html, render_batch(batch, parts))
    if json_file is not None:
        text = json.dumps(as_json(batch, list(parts)), indent=2, allow_nan=False)
        write_whole(json_file, text + '\n')
