# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line in the process of the tests, for commands that need no graph."""

from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
import signal
from subprocess import CompletedProcess

import pytest

from checkweigher_bringup.cli import main


def run_here(*arguments: object) -> CompletedProcess[str]:
    """Run a command as `run_command` does; its exit status, output and errors are the same."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    handlers = {number: signal.getsignal(number) for number in numbers}
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as errors:
        try:
            with pytest.raises(SystemExit) as end:
                main([str(argument) for argument in arguments])
        finally:  # the command ignores them at its end, as would every process started later
            for number, handler in handlers.items():
                signal.signal(number, handler)
    return CompletedProcess(arguments, int(end.value.code), out.getvalue(), errors.getvalue())


def refused(*arguments: object) -> str:
    """Run a command that must be refused, and return its line."""
    done = run_here(*arguments)
    assert (done.returncode, done.stdout) == (2, ''), done
    (line,) = done.stderr.splitlines()
    assert line.isprintable()
    return line
