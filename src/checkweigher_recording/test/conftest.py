# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small recording and its messages."""

from pathlib import Path

from foreign_bags import Message, messages_of
from lines import write_line
import pytest

from checkweigher_core.recording import Recording
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


@pytest.fixture(scope='session')
def recording() -> Recording:
    return simulate(SimulationParameters(count=2, lead_in=0.2, run_out=0.1))


@pytest.fixture
def bag(tmp_path: Path, recording: Recording) -> Path:
    return write_line(tmp_path / 'bag', recording)


@pytest.fixture
def messages(recording: Recording) -> list[Message]:
    return messages_of(recording)
