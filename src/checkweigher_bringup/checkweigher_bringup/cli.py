# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command line program, which runs a command and prints an error of the user as one line."""

import signal

# Ctrl-C during the imports ends the program without a traceback.
if __name__ == '__main__':
    signal.signal(signal.SIGINT, signal.SIG_DFL)

import argparse
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper
import os
from re import sub
import sys
from types import FrameType, ModuleType
from typing import Any, NoReturn

from checkweigher_bringup.commands import add_options
from checkweigher_core.parent_process import end_with_parent
from checkweigher_core.printable import one_line

# Groups of commands: the folder in commands/, the title, and the modules of the commands. The
# docstring of a module contains the purpose of the command, and examples. The module of the command
# `import` has the name `import_`, because `import` is a reserved word.
_GROUPS = (
    (
        'line',
        'running line',
        (
            *('run', 'status', 'echo', 'record', 'calibrate', 'page', 'gateway', 'policy', 'user'),
            *('certificate', 'backup', 'restore'),
        ),
    ),
    ('recordings', 'recorded bags', ('weigh', 'replay', 'simulate', 'import_', 'keep', 'recover')),
    ('accuracy', 'accuracy', ('tune', 'evaluate', 'verify')),
    ('production', 'production', ('batch', 'giveaway', 'tare', 'sign', 'performance', 'audit')),
)
COMMANDS = tuple(name.rstrip('_') for *_, names in _GROUPS for name in names)

_PROGRAM = 'checkweigher'
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # signals that end a command


class _Ended(KeyboardInterrupt):
    """Raised if a signal ends the command.

    If a plain KeyboardInterrupt were raised in code that `exec` runs, Python would kill itself by
    SIGINT at its exit, even if the exception was caught. The definition of a dataclass, for
    example, uses `exec`.
    """


class _Parser(argparse.ArgumentParser):
    """Parser of a command line that prints each error as one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f'{self.prog}: {one_line(message)}; see {self.prog} --help\n')


class _Version(argparse.Action):
    """Option that prints the version of the program and its legally relevant software."""

    def __init__(self, **options: Any) -> None:
        super().__init__(nargs=0, **options)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        """Print the version, and exit."""
        from checkweigher_dsp.legal import version_text

        parser.exit(0, version_text() + '\n')


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with the options of all commands."""
    parser = _Parser(
        prog=_PROGRAM,
        description='An in-motion checkweigher: masses and verdicts of products on a belt scale.',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--version', action=_Version, help='show version and digests, and exit')
    commands = parser.add_subparsers(
        dest='command', metavar='COMMAND', required=True, parser_class=_Parser
    )
    examples = ''
    for folder, title, names in _GROUPS:
        examples += f'  # {title}\n'
        for name in names:
            module = import_module(f'checkweigher_bringup.commands.{folder}.{name}')
            _add_command(commands, name.rstrip('_'), module)
            examples += f'  {examples_of(module)[0]}\n'
    parser.epilog = f'examples:\n{examples}\n{_PROGRAM} COMMAND --help shows the options of each.'
    return parser


def examples_of(module: ModuleType) -> list[str]:
    """Return the examples in the docstring of a command module."""
    return [line.strip() for line in str(module.__doc__).splitlines() if line.startswith(_PROGRAM)]


def _add_command(
    commands: 'argparse._SubParsersAction[_Parser]', name: str, module: ModuleType
) -> None:
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

    The status is 0 if the command succeeds, and 1 if it reports a failure, such as an item without
    a verdict. The status is 2 if the input or the output cannot be used, and 128 + N if signal N
    interrupted the command (130 for Ctrl-C). A command that runs until a signal arrives, such as
    `echo`, completes its work after the signal, and then has the status 0 or 1. The command `run`
    is an exception, because its status after the signal is 128 + N.
    """
    received: list[int] = []

    def interrupt(number: int, _: FrameType | None) -> None:
        received.append(number)
        raise _Ended

    try:
        _prepare(interrupt)
        status = _run(sys.argv[1:] if arguments is None else arguments)
    except BaseException as error:
        # C++ code may have replaced `_Ended` by another exception, so the received signal decides.
        if not received:
            raise
        status = 128 + received[0] if not isinstance(error, SystemExit) else _status_of(error)
    # Ignore further signals, which would print a traceback during the exit of Python.
    for number in _ENDING:
        signal.signal(number, signal.SIG_IGN)
    sys.exit(status)


def _prepare(interrupt: Callable[[int, FrameType | None], None]) -> None:
    """Install the signal handler `interrupt`, and prepare the standard streams.

    The handler is installed for the signals in `_ENDING`, except for SIGHUP if SIGHUP is ignored.
    The null device replaces each closed standard stream. The standard output escapes characters
    that it cannot encode. From now on, this process also ends when its parent process ends, if the
    parent process has started it with the environment of `child_environment`.
    """
    end_with_parent()
    for number in _ENDING:
        # A background command of a shell script starts with SIGINT ignored. Install the handler
        # even if SIGINT is ignored, so that SIGINT ends a recording. The command nohup starts a
        # command with SIGHUP ignored, so SIGHUP must stay ignored.
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt)
    # Open the null device in place of each closed standard stream. Otherwise, the next opened file
    # would take the file number of the stream, and the output of the command would go to that file.
    while (file := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(file)
    sys.stdout = sys.stdout or os.fdopen(1, 'w', closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, 'w', closefd=False)
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors='backslashreplace')


def _run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit status. Print an error of the user as one line on stderr.

    The status is 0 if the program that reads the output has ended. After an error of the user, the
    status is the attribute `exit_status` of the exception, or 2 if the exception has no such
    attribute. Other exceptions propagate to the caller.
    """
    command = ''
    try:
        try:
            parsed = build_parser().parse_args(arguments)
            command = f' {parsed.command}'
            status = int(parsed.run(parsed))
        except SystemExit as error:  # argparse has already printed the message.
            status = _status_of(error)
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # The program that reads the output, such as head, has ended.
        _discard_output()
        return 0
    except (MemoryError, OSError, RuntimeError, ValueError) as error:
        line = _line_for(error)
        if not line:
            raise
        if isinstance(error, OSError):
            _discard_output()
        status = getattr(error, 'exit_status', 2)
    with suppress(OSError):  # A closed terminal must not change the exit status.
        print(f'{_PROGRAM}{command}: {one_line(line)}', file=sys.stderr)
    return status


def _line_for(error: Exception) -> str:
    """Return the message of an error that the user can correct, or '' for a program defect."""
    # Exceptions of this project have a message for the user, so the message is used unchanged.
    if type(error).__module__.startswith('checkweigher_'):
        return str(error)
    if isinstance(error, OSError):
        return f'{error.filename or "the output"}: {error.strerror or error}'
    if isinstance(error, MemoryError):
        return 'not enough memory for this'
    # The class is compared by its name, because most commands do not import rclpy. If ROS security
    # is enabled, an invalid keystore usually causes the RCLError, and the user can correct the
    # keystore.
    if type(error).__name__ == 'RCLError' and os.environ.get('ROS_SECURITY_ENABLE') == 'true':
        text = sub(r',? at /\S+:\d+', '', ' '.join(str(error).split()))
        return f'ROS_SECURITY_ENABLE=true: {text.rstrip(".,")}'
    return ''


def _discard_output() -> None:
    """Redirect standard output to the null device, because flushing its buffer would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


def _status_of(error: SystemExit) -> int:
    return error.code if isinstance(error.code, int) else int(error.code is not None)


if __name__ == '__main__':
    main()
