# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages: those of a bag against those that are installed."""

import json
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
import pytest

from checkweigher_dsp.ros.ports import ALL, LOAD_CELL_INFO, LOAD_CELL_SAMPLES, PHOTO_EYES
from checkweigher_recording.bags.definitions import deserialize, serialize, typestore


@pytest.mark.parametrize('port', ALL, ids=lambda port: port.name)
def test_type_hashes_are_those_of_the_installed_messages(port):
    package, folder, name = port.message_type.split('/')
    path = Path(get_package_share_directory(package), folder, f'{name}.json')
    hashes = {
        entry['type_name']: entry['hash_string']
        for entry in json.loads(path.read_text())['type_hashes']
    }

    assert typestore().hash_rihs01(port.message_type) == hashes[port.message_type]


def test_a_record_is_the_same_after_it_was_written_and_read(recording):
    cell, (edge, *_) = recording.load_cell, recording.edges

    assert deserialize(LOAD_CELL_INFO, serialize(LOAD_CELL_INFO, cell, 5)) == cell
    assert deserialize(PHOTO_EYES, serialize(PHOTO_EYES, edge, 5)) == edge
    for expected in recording.blocks[:3]:
        block = deserialize(LOAD_CELL_SAMPLES, serialize(LOAD_CELL_SAMPLES, expected, 5))
        assert (block.stamp, block.first_index) == (expected.stamp, expected.first_index)
        assert block.counts.tolist() == expected.counts.tolist()
