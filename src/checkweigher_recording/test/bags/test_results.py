# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of any ports, read from a bag."""

import hashlib
from pathlib import Path

import pytest

from checkweigher_core.records import Decision, StepState, Verdict, VerificationStep
from checkweigher_core.ros.ports import STOP_REQUEST, VERDICT, VERIFICATION
from checkweigher_recording.bags.definitions import BagError, serialize
from checkweigher_recording.bags.results import mcap_digest, read_records
from checkweigher_recording.bags.writing import BagWriter

T = 1_700_000_000_000_000_001
VERDICTS = [
    Verdict(number, T + number, Decision.ACCEPT, mass=0.1, std_dev=1e-4, reject_at=T, t1=T - 5,
            estimate_id=number)
    for number in (1, 2)
]  # fmt: skip
STEP = VerificationStep(T, 'zero_1', StepState.DONE, T - 7, 'text')


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Bag of two verdicts and a step, of a lane."""
    with BagWriter(tmp_path / 'bag', (VERDICT, VERIFICATION), 'lane1') as writer:
        for number, verdict in enumerate(VERDICTS):
            writer.put(VERDICT, T + number, serialize(VERDICT, verdict, T))
        writer.put(VERIFICATION, T, serialize(VERIFICATION, STEP, T))
    return tmp_path / 'bag'


def test_records_are_read_as_they_were_written(bag: Path):
    found = read_records(bag, VERDICT, VERIFICATION, STOP_REQUEST)
    assert found == {'verdict': VERDICTS, 'verification': [STEP], 'stop_request': []}
    assert read_records(bag, STOP_REQUEST) == {'stop_request': []}
    file = bag / 'line_0.mcap'
    assert mcap_digest(bag) == hashlib.sha256(file.read_bytes()).hexdigest()


def test_what_was_changed_is_refused(bag: Path):
    file = bag / 'line_0.mcap'
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(BagError, match='damaged'):
        read_records(bag, VERDICT)
    (bag / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match='not the folder of a whole MCAP bag'):
        read_records(bag, VERDICT)
