# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A PLC, and what is written to the disk."""

from collections.abc import Iterator
import os
from pathlib import Path

from modbus_machine import Plc
import pytest


@pytest.fixture
def plc(tmp_path: Path) -> Iterator[Plc]:
    """Return a PLC that is yet to be started."""
    made = Plc(tmp_path)
    yield made
    if made.process is not None and made.process.poll() is None:
        made.kill()


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return the list to which each file and folder is added that is written to the disk."""
    found: list[Path] = []
    sync = os.fsync

    def note(number: int) -> None:
        sync(number)
        found.append(Path(os.readlink(f'/proc/self/fd/{number}')))

    monkeypatch.setattr(os, 'fsync', note)
    return found
