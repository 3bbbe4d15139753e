# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command line, which runs a command and prints each error as one line."""

import signal

if __name__ == '__main__':  # until the handlers are installed
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

from checkweigher_bringup.commands import add_options
from checkweigher_core.parent_process import end_with_parent
from checkweigher_core.printable import one_line

# Folder in commands/, its title, and its commands, each a module. The docstring of a module has the
# purpose of its command, and examples.
_GROUPS = (
    (
        'line',
        'a line that runs',
        (
            *('run', 'status', 'echo', 'record', 'calibrate', 'page', 'policy', 'user'),
            *('certificate', 'backup', 'restore'),
        ),
    ),
    ('recordings', 'recorded bags', ('weigh', 'replay', 'simulate', 'import', 'keep', 'recover')),
    ('accuracy', 'how accurate it is', ('tune', 'evaluate', 'verify')),
    ('production', 'what was produced and changed', ('batch', 'performance', 'audit')),
)
COMMANDS = tuple(name for *_, names in _GROUPS for name in names)

_PROGRAM = 'checkweigher'
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # signals that end a command


class _Ended(KeyboardInterrupt):
    """Exception for a signal that ends the command.

    It is not a plain KeyboardInterrupt, because Python ends by SIGINT if one is raised in code that
    `exec` runs, such as the definition of a dataclass, even if it is caught.
    """


class _Parser(argparse.ArgumentParser):
    """Parser that prints each error as one line, like the commands."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: {one_line(message)}; see {self.prog} --help\n')


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with the options of all commands."""
    parser = _Parser(
        prog=_PROGRAM,
        description='An in-motion checkweigher: masses and verdicts of products on a belt scale.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(
        dest='command', metavar='COMMAND', required=True, parser_class=_Parser
    )
    examples = ''
    for folder, title, names in _GROUPS:
        examples += f'  # {title}\n'
        for name in names:
            module = _module_of(folder, name)
            _add_command(commands, name, module)
            examples += f'  {examples_of(module)[0]}\n'
    parser.epilog = f'examples:\n{examples}\n{_PROGRAM} COMMAND --help shows the options of each.'
    return parser


def _module_of(folder: str, command: str) -> ModuleType:
    # A module cannot have the name `import`, which is a keyword.
    suffix = '_' if iskeyword(command) else ''
    return import_module(f'checkweigher_bringup.commands.{folder}.{command}{suffix}')


def examples_of(module: ModuleType) -> list[str]:
    """Return the examples of a command, from the docstring of its module."""
    return [line.strip() for line in str(module.__doc__).splitlines() if line.startswith(_PROGRAM)]


def _add_command(
    commands: 'argparse._SubParsersAction[_Parser]', name: str, module: ModuleType
) -> None:
    """Add a command with the purpose, the options and the examples of its module."""
    purpose = str(module.__doc__).partition('\n')[0]
    examples = examples_of(module)
    parser = commands.add_parser(
        name,
        help=purpose[0].lower() + purpose[1:].rstrip('.'),
        description=purpose,
        epilog='\n  '.join([f'example{"s" * (len(examples) > 1)}:', *examples]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_options(parser, module.OPTIONS)
    parser.set_defaults(run=module.run)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command and exit with its status.

    The status is 0 on success, 1 on a failure that the command reports, such as an item without a
    verdict, 2 on bad input or output, and 128 + N if signal N ended it (130 for Ctrl-C).
    """
    came: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        came.append(number)
        raise _Ended

    try:
        _prepare(interrupt)
        status = _run(sys.argv[1:] if arguments is None else arguments)
    except BaseException as error:
        # C++ code may have turned the KeyboardInterrupt into another exception.
        if not came:
            raise
        status = 128 + came[0] if not isinstance(error, SystemExit) else _status_of(error)
    for number in _ENDING:  # else one during the exit of Python prints a traceback
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _prepare(interrupt: Callable[[int, FrameType | None], None]) -> None:
    """Make signals interrupt the command, and standard streams accept any text."""
    end_with_parent()
    for number in _ENDING:
        # A script starts background commands with SIGINT ignored, but SIGINT must end a
        # recording there, too. SIGHUP stays ignored under nohup.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt)
    # If a standard stream is closed, the next file would get its number and its output.
    while (file := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(file)
    sys.stdout = sys.stdout or os.fdopen(1, 'w', closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, 'w', closefd=False)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')


def _run(arguments: Sequence[str]) -> int:
    """Run a command and return its status; print an error that the user can correct as one line."""
    command = ''
    try:
        try:
            parsed = build_parser().parse_args(arguments)
            command = f' {parsed.command}'
            status = int(parsed.run(parsed))
        except SystemExit as error:  # argparse has printed the reason
            status = _status_of(error)
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # the reader of the output, such as head, has ended
        _discard_output()
        return 0
    except (MemoryError, OSError, RuntimeError, ValueError) as error:
        line = _line_for(error)
        if not line:
            raise
        if isinstance(error, OSError):
            _discard_output()
        status = getattr(error, 'exit_status', 2)
    with suppress(OSError):  # the terminal may be gone
        print(f'{_PROGRAM}{command}: {one_line(line)}', file=sys.stderr)
    return status


def _line_for(error: Exception) -> str:
    """Return the message for an error that the user can correct; empty for a defect."""
    # The message of an error of this project is one line for the user.
    if type(error).__module__.startswith('checkweigher_'):
        return str(error)
    if isinstance(error, OSError):
        return f'{error.filename or "the output"}: {error.strerror or error}'
    if isinstance(error, MemoryError):
        return 'not enough memory for this'
    # Compared by name, because only commands of a graph import rclpy. With ROS security on, an
    # RCLError usually means an invalid keystore, which the user can correct.
    if type(error).__name__ == 'RCLError' and os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        text = sub(r',? at /\S+:\d+', '', ' '.join(str(error).split()))
        return f'ROS_SECURITY_ENABLE=true: {text.rstrip(".,")}'
    return ''


def _discard_output() -> None:
    """Discard the buffer of the standard output, because writing it would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _status_of(error: SystemExit) -> int:
    return error.code if isinstance(error.code, int) else int(error.code is not None)


if __name__ == '__main__':
    main()
