# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages: those of a bag against those that are installed."""

import json
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from checkweigher_core.records import Decision, Verdict
from checkweigher_core.ros.ports import (
    LOAD_CELL_INFO,
    LOAD_CELL_SAMPLES,
    PHOTO_EYES,
    RECORDED,
    VERDICT,
)
from checkweigher_recording.bags.definitions import BagError, deserialize, serialize, typestore
from checkweigher_recording.bags.results import read_records


@pytest.mark.parametrize('port', RECORDED, ids=lambda port: port.name)
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


def bag_with_verdict(path: Path, *left_out: str) -> None:
    """Write a bag with a verdict whose definition lacks some fields."""
    text = Path(get_package_share_directory('checkweigher_msgs'), 'msg', 'Verdict.msg').read_text()
    declared = [line.partition('#')[0].split() for line in text.splitlines()]
    kept = [' '.join(words) for words in declared if words and words[-1] not in left_out]
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg('\n'.join(kept), VERDICT.message_type))
    new = typestore([VERDICT]).deserialize_cdr(
        serialize(VERDICT, Verdict(7, 5, Decision.OVER, mass=0.2, station=2), 5),
        VERDICT.message_type,
    )
    fields = [name for name, _ in store.fielddefs[VERDICT.message_type][1]]
    message = store.types[VERDICT.message_type](*(getattr(new, name) for name in fields))
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/verdict', VERDICT.message_type, typestore=store)
        writer.write(connection, 5, store.serialize_cdr(message, VERDICT.message_type))


def test_a_verdict_from_before_there_were_stations_is_still_read(tmp_path):
    bag_with_verdict(tmp_path / 'older', 'station', 'station_at')

    (verdict,) = read_records(tmp_path / 'older', VERDICT)[VERDICT.name]

    assert verdict.station_at is None
    assert (verdict.item_id, verdict.t3, verdict.decision, verdict.station) == (7, 5, 3, 0)


def test_a_verdict_that_lacks_another_field_is_refused(tmp_path):
    bag_with_verdict(tmp_path / 'foreign', 'mass')

    with pytest.raises(BagError, match='another definition'):
        read_records(tmp_path / 'foreign', VERDICT)
