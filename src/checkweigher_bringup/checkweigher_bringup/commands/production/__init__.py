# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands for batches, giveaway, tares, signatures, performance tests, and the audit log."""

from pathlib import Path
from typing import Any


def write_claim(log: Path, lane: str, kind: str, subject: str, value: Any, who: str) -> None:
    """Write an entry to the audit log `log`.

    If a running line has the log open, the node `product` of the lane `lane` writes the entry. The
    entry states that the name `who` is a claim, because the log cannot check it. Raises
    `AuditError` or `UserError` if the entry cannot be written.
    """
    import time

    from checkweigher_core.records import utc
    from checkweigher_production.audit_log import AuditLog, LogInUseError
    from checkweigher_production.audit_trail import CLAIMED

    try:
        with AuditLog(log) as opened:
            now = utc(time.time_ns())
            opened.append(now, 'checkweigher', kind, subject, None, value, f'{CLAIMED}{who}')
    except LogInUseError:
        from checkweigher_bringup.commissioning.lane_client import technician, write_to_log
        from checkweigher_bringup.settings import check_namespace

        with technician(check_namespace(lane)) as node:
            write_to_log(node, kind, subject, value, who)
