# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line: runs a command, and prints each error as one line."""

import argparse
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
import os
import signal
import sys
from types import ModuleType
from typing import NoReturn

# Name, purpose and one example of each; its module in commands/ has its name.
COMMANDS = (
    ('simulate', 'write a bag of simulated products with known masses',
     'simulate --speed 60 --mass 134.5 --count 20 --output /tmp/line'),
    ('weigh', 'weigh a bag offline, with the same stages as the graph',
     'weigh bags/paper_60 --csv masses.csv'),
    ('replay', 'play a bag through the ROS graph and show each verdict',
     'replay bags/paper_60 --rate 0'),
    ('run', 'run a live line, show each verdict, start again what dies',
     'run --params my_line.yaml --processes'),
    ('record', 'record a running graph into a bag',
     'record --output /tmp/shift1 --duration 60'),
    ('recover', 'make a whole bag of a recording that broke off',
     'recover shift1 --output shift1_whole'),
    ('echo', 'show masses and verdicts of a running graph as they come',
     'echo --namespace lane1'),
    ('status', 'show what is wrong with a running line, worst first, and what to check',
     'status --count 1'),
    ('tune', 'learn parameters from passes of known mass',
     'tune bags/paper_30 bags/paper_60 bags/paper_90 --output machine.yaml'),
    ('evaluate', 'show the accuracy of the estimators on passes of known mass',
     'evaluate --protocol paper --html report.html'),
    ('calibrate', 'calibrate the load cell with known masses at rest',
     'calibrate --masses 200 500 1000 --source aed --output /etc/checkweigher/lane1.yaml'),
    ('audit', 'verify the chain of an audit log and show what was changed',
     'audit /var/log/checkweigher/lane1.log'),
    ('import', 'turn a CSV log of a scale into a bag',
     'import log.csv --edges log.edges.json --slope 5.19e-4 --offset -4874.4 --output /tmp/log'),
)  # fmt: skip

_PROGRAM = 'checkweigher'


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as those of the commands are."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: {message}; see {self.prog} --help\n')


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command line, with the options of `only` one command or of all."""
    names = [name for name, *_ in COMMANDS]
    examples = '\n'.join(f'  {_PROGRAM} {example}' for *_, example in COMMANDS)
    parser = _Parser(
        prog=_PROGRAM,
        description='An in-motion checkweigher: masses and verdicts of products on a belt scale.',
        epilog=f'examples:\n{examples}\n\n{_PROGRAM} COMMAND --help shows the options of each.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(
        dest='command', metavar='COMMAND', required=True, parser_class=_Parser
    )
    for name, text, example in COMMANDS:
        command = commands.add_parser(
            name,
            help=text,
            description=text[0].upper() + text[1:] + '.',
            epilog=f'example:\n  {_PROGRAM} {example}',
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if only == name or only not in names:
            _module_of(name).add_arguments(command)
    return parser


def _module_of(command: str) -> ModuleType:
    # `import` is a word of Python, and no module can be imported by that name.
    suffix = '_' if iskeyword(command) else ''
    return import_module(f'checkweigher_bringup.commands.{command}{suffix}')


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its status.

    0 if it did what was asked, 1 if the line let an item go without a verdict, 2 on bad input,
    130 if it was interrupted.
    """
    # A script that starts a command in the background has SIGINT ignored in it; asking a recording
    # to end has to work there, too.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    arguments = sys.argv[1:] if arguments is None else arguments
    parsed = build_parser(arguments[0] if arguments else None).parse_args(arguments)
    try:
        status = _module_of(parsed.command).run(parsed)
        sys.stdout.flush()
    except ValueError as error:
        # Bags, parameters, CSV logs and outputs raise their own kinds of ValueError, each with
        # one line for the user. Any other one is a defect and keeps its traceback.
        if not type(error).__module__.startswith('checkweigher_'):
            raise
        line = ' '.join(str(error).split())
        print(f'{_PROGRAM} {parsed.command}: {line}', file=sys.stderr)
        status = getattr(error, 'exit_status', 2)
    except BrokenPipeError:
        # The reader of the output, such as head, has ended.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 0
    except KeyboardInterrupt:
        status = 130
    sys.exit(status)


if __name__ == '__main__':
    main()
