# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node that writes the report of each finished batch beside its record.

The node runs in its own process with a lower priority than the line, because no other node waits
for a report. The node writes the SHA-256 of each report to the audit log of the lane.
"""

import os
from pathlib import Path

from checkweigher_core.changes import REPORT
from checkweigher_core.input_files import sha256_of
from checkweigher_core.records import BatchResult
from checkweigher_core.ros import ports
from checkweigher_core.ros.change_record import ChangeRecord
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.running import run

_POLL_PERIOD = 0.5  # s
_SEED = 1  # seed for the samples of the reference test
_NICENESS = 10


class BatchReporter(PortNode):
    """Node that reports on each batch that the node `product` publishes as finished."""

    def __init__(self) -> None:
        super().__init__('batch_reporter')
        self._todo: list[BatchResult] = []
        self._record = ChangeRecord(self)
        self.subscribe(ports.BATCH_RESULT, self._todo.append)
        self.create_timer(_POLL_PERIOD, self._report)

    async def _report(self) -> None:
        while self._todo:
            result = self._todo.pop(0)
            files = write_files(Path(result.record), result.sha256)
            if reason := await self._record.write(REPORT, result.batch, files):
                self.warn(f'batch {result.batch!r}: its report is {reason}')
            self.get_logger().info(f'batch {result.batch!r}: {", ".join(files)}')


def write_files(record: Path, sha256: str) -> dict[str, str]:
    """Write the report on a batch as HTML and JSON, and return the SHA-256 of each file by name.

    The files are in the folder of the record, and have its name with the suffix `.html` or `.json`.

    Raises `ValueError` if `sha256` is not the SHA-256 of the record, `RecordError` or `AuditError`
    if the record or its audit log cannot be read, and `OutputError` if a file cannot be written.
    """
    # Import these modules late, because the import is slow, and is not needed before a batch has
    # finished.
    from checkweigher_bringup.batch_report import write_report
    from checkweigher_production.batch_record import read_lines
    from checkweigher_validation.batch.batch import read_recorded
    from checkweigher_validation.batch.figures import figures_of

    # The node `product` has just written the record, so the audit log that the record names is the
    # log of this lane.
    log = next(read_lines(record)).get('audit_log')
    batch = read_recorded(record, Path(log) if log else None)
    if batch.sha256 != sha256:
        raise ValueError(f'{record}: the record was changed after the end of the batch')
    files = record.with_suffix('.html'), record.with_suffix('.json')
    write_report(batch, [figures_of(part, _SEED) for part in batch.parts], *files)
    return {path.name: sha256_of(path) for path in files}


def main() -> None:
    """Run the node."""
    os.nice(_NICENESS)
    run(BatchReporter)


if __name__ == '__main__':
    main()
