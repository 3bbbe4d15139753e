# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Restore the folder of a machine from a backup, and write an entry to its audit log.

Examples
--------
checkweigher restore my_machine.tar --folder my_machine
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import REQUIRED

OPTIONS = (
    ('archive FILE', Path, 'archive that checkweigher backup has written'),
    ('--folder DIR', Path, 'new folder of the machine', REQUIRED),
    ('--who NAME', str, 'your name for the audit log; default: the user of the computer'),
)


def run(arguments: argparse.Namespace) -> int:
    """Restore the folder, and write an entry to the audit log if the folder contains a log.

    Returns 1 without writing an entry if the chain of the audit log is broken, otherwise 0.
    """
    from getpass import getuser
    import time

    from checkweigher_bringup.backup import print_log, restore_backup
    from checkweigher_core.changes import BACKUP
    from checkweigher_core.input_files import sha256_of
    from checkweigher_core.records import utc
    from checkweigher_production.audit_log import AuditLog
    from checkweigher_production.audit_trail import CLAIMED

    count = restore_backup(arguments.archive, arguments.folder)
    print(f'{arguments.folder}: {count} files, each with the SHA-256 in the backup')
    path = arguments.folder / 'audit.log'
    if not path.exists():
        return 0
    if not print_log(path):
        return 1
    value = {'file': arguments.archive.name, 'sha256': sha256_of(arguments.archive)}
    with AuditLog(path) as log:
        who = CLAIMED + (arguments.who or getuser())
        now = utc(time.time_ns())
        entry = log.append(now, 'restore', BACKUP, 'folder', None, value, who)
    print(f'entry {entry.sequence} of the audit log, on this restore, has the hash {entry.hash}')
    return 0
