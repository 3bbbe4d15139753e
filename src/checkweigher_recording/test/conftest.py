# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small recording and its messages."""

from foreign_bags import Message, messages_of
import pytest

from checkweigher_core.recording import Recording
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


@pytest.fixture(scope='session')
def recording() -> Recording:
    return simulate(SimulationParameters(count=2, lead_in=0.2, run_out=0.1))


@pytest.fixture
def messages(recording: Recording) -> list[Message]:
    return messages_of(recording)
