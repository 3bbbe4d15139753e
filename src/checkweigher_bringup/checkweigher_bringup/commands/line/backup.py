# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Save the folder of a machine as an archive with checksums; the line may run.

Examples
--------
checkweigher backup my_machine --output my_machine.tar
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import REQUIRED

OPTIONS = (
    ('folder DIR', Path, 'folder of the machine, as in run --folder'),
    ('--output FILE', Path, 'archive (tar) to write', REQUIRED),
)


def run(arguments: argparse.Namespace) -> int:
    """Write the archive. Return 1 if the chain of the audit log is broken, otherwise 0."""
    from checkweigher_bringup.backup import print_log, write_backup
    from checkweigher_core.whole_file import check_folder_of

    check_folder_of(arguments.output)
    count = write_backup(arguments.folder, arguments.output)
    print(f'{arguments.output}: {count} files')
    log = arguments.folder / 'audit.log'
    return 0 if not log.exists() or print_log(log) else 1
