# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the tests of the commands and the line."""

from subprocess import CompletedProcess

from here import run_here
import pytest
from running import Run, run_command

_HERE = 'weigh', 'simulate', 'import'  # which need no graph and no further processes


@pytest.fixture
def checkweigher() -> Run:
    """Return a function that runs a command which must succeed, in this process if possible."""

    def run(command: str, *arguments: object) -> CompletedProcess[str]:
        done = (run_here if command in _HERE else run_command)(command, *arguments)
        assert done.returncode == 0, done.stderr
        return done

    return run
