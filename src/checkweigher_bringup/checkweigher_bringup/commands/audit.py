"""Verify an audit log and show what was changed."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `audit`."""
    parser.add_argument('log', type=Path, metavar='LOG', help='audit log; LOG.head is beside it')
    parser.add_argument(
        '--hash', default='', metavar='HASH',
        help='an entry with this hash, noted elsewhere, has to be there',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print JSON instead of a table')


def run(arguments: argparse.Namespace) -> int:
    """Show the changes; 1 if the chain is broken."""
    from checkweigher_bringup.auditing import as_json, as_table, conclusion
    from checkweigher_dsp.production.audit_log import read_log

    found = read_log(arguments.log, arguments.hash.strip().lower())
    if arguments.json:
        print(as_json(found))
    else:
        for line in as_table(found.entries):
            print(line)
        print(conclusion(found))
    return 0 if found.whole else 1
