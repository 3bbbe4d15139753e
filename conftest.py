# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and fixtures of all tests of the workspace."""

from collections.abc import Iterator
from pathlib import Path
import subprocess
import sys

from hypothesis import HealthCheck, settings
import pytest
from running import Rows, Run, read_rows, run_command

# `make test` tries the same examples whichever tests run; no test fails because a machine is slow.
_COMMON = {'deadline': None, 'max_examples': 50, 'suppress_health_check': [HealthCheck.too_slow]}
settings.register_profile('test', derandomize=True, database=None, **_COMMON)
# `make soak` draws anew, and tries first what failed before: .hypothesis keeps it.
settings.register_profile('soak', derandomize=False, print_blob=True, **_COMMON)


def pytest_configure(config: pytest.Config) -> None:
    """Choose the examples of hypothesis."""
    settings.load_profile('soak' if config.getoption('markexpr') == 'soak' else 'test')


@pytest.fixture(autouse=True)
def _turns_of_threads() -> Iterator[None]:
    """Keep what a machine's threads want of the interpreter from the tests after them."""
    interval = sys.getswitchinterval()
    yield
    sys.setswitchinterval(interval)


@pytest.fixture(autouse=True)
def _state_of_machines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what a line leaves on its belt from the user's own lines and from other tests."""
    monkeypatch.setenv('XDG_STATE_HOME', str(tmp_path / 'state'))


@pytest.fixture
def checkweigher() -> Run:
    """Run a command that must succeed."""

    def run(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
        done = run_command(*arguments, timeout=timeout)
        assert done.returncode == 0, done.stderr
        return done

    return run


@pytest.fixture
def rows(checkweigher: Run, tmp_path: Path) -> Rows:
    """Run a command with --csv and return the rows that it wrote."""

    def run(*arguments: object) -> list[dict[str, str]]:
        path = tmp_path / f'{len(list(tmp_path.iterdir()))}.csv'
        checkweigher(*arguments, '--csv', path)
        return read_rows(path)

    return run
