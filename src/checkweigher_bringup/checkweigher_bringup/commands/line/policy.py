# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write the security policy of a line for SROS2: the rights of each node.

Examples
--------
checkweigher policy --namespace lane1 lane2 --output policy.xml
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import OVERWRITE

_LANES = 'namespaces of the lanes; default: one lane without a namespace'
OPTIONS = (
    ('--namespace NAME', str, _LANES, {'nargs': '*', 'default': ['']}),
    ('--output FILE', Path, 'file to write; default: the standard output'),
    OVERWRITE,
)


def run(arguments: argparse.Namespace) -> int:
    """Write the security policy to a file or to the standard output."""
    from checkweigher_bringup.output import check_output_file
    from checkweigher_bringup.settings import check_namespace
    from checkweigher_core.ros.graph.policy import policy
    from checkweigher_core.whole_file import write_whole

    check_output_file(arguments.output, arguments.overwrite)
    text = policy([check_namespace(each) for each in arguments.namespace])
    if arguments.output is None:
        print(text, end='')
    else:
        write_whole(arguments.output, text)
    return 0
