# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line: runs a command, and prints each error as one line."""

import signal

if __name__ == '__main__':  # until there is something to end in order
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper
from keyword import iskeyword
import os
from re import sub
import sys
from types import FrameType, ModuleType
from typing import NoReturn

from checkweigher_core.parent_process import end_with_parent
from checkweigher_core.printable import one_line

# Name, purpose and one example of each, by folder of commands/: its module there has its name.
GROUPS = {
    'line': (
        ('run', 'run a live line, show each verdict, start again what dies',
         'run --params my_line.yaml --processes'),
        ('status', 'show what is wrong with a running line, worst first, and what to check',
         'status --count 1'),
        ('echo', 'show masses and verdicts of a running graph as they come',
         'echo --namespace lane1'),
        ('record', 'record a running graph into a bag',
         'record --output /tmp/shift1 --duration 60'),
        ('calibrate', 'calibrate the load cell with known masses at rest',
         'calibrate --masses 200 500 1000 --source aed --output /etc/checkweigher/lane1.yaml'),
        ('page', 'show the running lanes in a browser, and act on them with a login',
         'page --port 8080'),
        ('policy', 'write the security policy of a line for SROS2: what each node may do',
         'policy --namespace lane1 lane2 --output policy.xml'),
        ('user', 'add, list, change and remove the users of the page',
         'user add anna --role operator'),
        ('certificate', 'make a self-signed certificate for the page, and show its fingerprint',
         'certificate scale7.local 192.168.1.7 --certificate page.crt --key page.key'),
    ),
    'recordings': (
        ('weigh', 'weigh bags offline, with the same stages as the graph',
         'weigh bags/paper_60 --csv masses.csv'),
        ('replay', 'play a bag through the ROS graph and show each verdict',
         'replay bags/paper_60 --rate 0'),
        ('simulate', 'write a bag of simulated products with known masses',
         'simulate --speed 60 --mass 134.5 --count 20 --output /tmp/line'),
        ('import', 'turn a CSV log of a scale into a bag',
         'import log.csv --edges log.edges.json --slope 5.19e-4 --offset -4874.4 '
         '--output /tmp/log'),
        ('keep', 'cut an item out of a bag, as a small bag for a report',
         'keep shift1 --item 17 --output item17'),
        ('recover', 'make a whole bag of a recording that broke off',
         'recover shift1 --output shift1_whole'),
    ),
    'accuracy': (
        ('tune', 'learn parameters from passes of known mass',
         'tune bags/paper_30 bags/paper_60 bags/paper_90 --output machine.yaml'),
        ('evaluate', 'show the accuracy of the estimators on passes of known mass',
         'evaluate --protocol paper --html report.html'),
        ('verify', 'verify the machine by the book, and write the report',
         'verify plan.yaml --output /tmp/verification'),
    ),
    'production': (
        ('batch', "report on a batch: the packers' rules, the reference test, histogram, "
         'control chart',
         'batch bags/paper_60 --nominal 134.5 --html batch.html'),
        ('performance', 'make the performance test that the recipe asks for',
         'performance --who anna'),
        ('audit', 'verify the chain of an audit log and show what was changed',
         'audit /var/log/checkweigher/lane1.log'),
    ),
}  # fmt: skip
COMMANDS = tuple(row for rows in GROUPS.values() for row in rows)
_TITLES = {
    'line': 'a line that runs',
    'recordings': 'recorded bags',
    'accuracy': 'how accurate it is',
    'production': 'what was produced and changed',
}

_PROGRAM = 'checkweigher'
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # ask a command to end


class _Ended(KeyboardInterrupt):
    """A signal that ends the command.

    Python itself remembers a plain KeyboardInterrupt in a text that is executed, such as a
    dataclass in the making, and ends by SIGINT although it was caught.
    """


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, as those of the commands are."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: {one_line(message)}; see {self.prog} --help\n')


def build_parser(only: str | None = None) -> argparse.ArgumentParser:
    """Return the parser of the command line, with the options of `only` one command or of all."""
    names = [name for name, *_ in COMMANDS]
    examples = '\n'.join(
        line
        for group, rows in GROUPS.items()
        for line in (f'  # {_TITLES[group]}', *(f'  {_PROGRAM} {example}' for *_, example in rows))
    )
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
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        if only == name or only not in names:
            module = _module_of(name)
            module.add_arguments(command)
            command.epilog = _examples(example, *getattr(module, 'EXAMPLES', ()))
    return parser


def _examples(*examples: str) -> str:
    lines = ''.join(f'\n  {_PROGRAM} {one}' for one in examples)
    return f'example{"s" * (len(examples) > 1)}:{lines}'


def _module_of(command: str) -> ModuleType:
    group = next(group for group, rows in GROUPS.items() if command in {row[0] for row in rows})
    # `import` is a word of Python, and no module can be imported by that name.
    suffix = '_' if iskeyword(command) else ''
    return import_module(f'checkweigher_bringup.commands.{group}.{command}{suffix}')


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its status.

    0 if it did what was asked, 1 if the line let an item go without a verdict, 2 on bad input or
    an output that cannot be written, 128 + N if signal N ended it: 130 for Ctrl-C.
    """
    came: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        came.append(number)
        raise _Ended

    try:
        _prepare(interrupt)
        status = _run(sys.argv[1:] if arguments is None else arguments)
    except BaseException as error:
        # C++ on the way up may have made another exception of the KeyboardInterrupt.
        if not came:
            raise
        status = 128 + came[0] if not isinstance(error, SystemExit) else _status_of(error)
    for number in _ENDING:  # one that breaks into the end of Python ends it with a traceback
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _prepare(interrupt: Callable[[int, FrameType | None], None]) -> None:
    """Have signals interrupt the command, and standard streams that take any text."""
    end_with_parent()
    for number in _ENDING:
        # A script that starts a command in the background has SIGINT ignored in it; asking a
        # recording to end has to work there, too. nohup has SIGHUP ignored, and means it.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt)
    # A stream that was closed: the next file that is opened would take its number, and its text.
    while (file := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(file)
    sys.stdout = sys.stdout or os.fdopen(1, 'w', closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, 'w', closefd=False)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')


def _run(arguments: Sequence[str]) -> int:
    """Run a command and return its status, with one line for what the user can put right."""
    command = ''
    try:
        try:
            parsed = build_parser(arguments[0] if arguments else None).parse_args(arguments)
            command = f' {parsed.command}'
            status = int(_module_of(parsed.command).run(parsed))
        except SystemExit as error:  # of argparse, which has said why
            status = _status_of(error)
        sys.stdout.flush()
        return status
    except ValueError as error:
        # Bags, parameters, CSV logs and outputs raise their own kinds of ValueError, each with
        # one line for the user. Any other one is a defect and keeps its traceback.
        if not type(error).__module__.startswith('checkweigher_'):
            raise
        line, status = str(error), getattr(error, 'exit_status', 2)
    except BrokenPipeError:
        # The reader of the output, such as head, has ended.
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        line, status = f'{error.filename or "the output"}: {error.strerror or error}', 2
    except MemoryError:
        line, status = 'not enough memory for this', 2
    except RuntimeError as error:
        # Of rclpy, which only the commands of a graph import. What is wrong with the keystore is
        # for the user to put right, any other one is a defect.
        if type(error).__name__ != 'RCLError' or os.environ.get('ROS_SECURITY_ENABLE') != 'true':
            raise
        text, status = sub(r',? at /\S+:\d+', '', ' '.join(str(error).split())), 2
        line = f'ROS_SECURITY_ENABLE=true: {text.rstrip(".,")}'
    with suppress(OSError):  # the terminal may be gone
        print(f'{_PROGRAM}{command}: {one_line(line)}', file=sys.stderr)
    return status


def _discard_output() -> None:
    """Have what is still in the buffer of the standard output go nowhere: it would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _status_of(error: SystemExit) -> int:
    return error.code if isinstance(error.code, int) else int(error.code is not None)


if __name__ == '__main__':
    main()
