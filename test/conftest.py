"""What the tests of the whole workspace share: the command line and the rows that it writes."""

from collections.abc import Callable
import csv
from pathlib import Path
import subprocess

import pytest
from running import run_command

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def checkweigher() -> Run:
    """Run a command that must succeed."""

    def run(*arguments: object, timeout: float = 120) -> subprocess.CompletedProcess[str]:
        done = run_command(*arguments, timeout=timeout)
        assert done.returncode == 0, done.stderr
        return done

    return run


@pytest.fixture
def rows(checkweigher: Run, tmp_path: Path) -> Callable[..., list[dict[str, str]]]:
    """Run a command with --csv and return the rows that it wrote."""

    def run(*arguments: object) -> list[dict[str, str]]:
        path = tmp_path / f'{len(list(tmp_path.iterdir()))}.csv'
        checkweigher(*arguments, '--csv', path)
        with path.open(encoding='utf-8', newline='') as file:
            return list(csv.DictReader(file))

    return run
