# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Definitions of messages: those of a bag against those that are installed."""

import json
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from checkweigher_core.records import Decision, Verdict, newer_fields
from checkweigher_core.ros.ports import (
    LOAD_CELL_INFO,
    LOAD_CELL_SAMPLES,
    PHOTO_EYES,
    RECORDED,
    VERDICT,
)
from checkweigher_recording.bags.definitions import BagError, deserialize, serialize, typestore
from checkweigher_recording.bags.results import read_records

# Fields of each message in the first version. Do not extend it for a new field.
FIRST_FIELDS = {
    'LoadCellInfo': (
        'header model serial_number sample_rate counts_per_kg zero_counts min_counts max_counts '
        'capacity weigh_length'
    ),
    'LoadCellSamples': 'header first_index counts',
    'PhotoEyeEvent': 'header eye blocked',
    'ReferenceMass': 'header mass',
    'StreamStatus': 'header stream state samples edges items text',
    'Item': 'header stream item_id t1 t2 t3 line_speed complete reasons',
    'WeighWindow': (
        'header item_id t1 t2 t3 belt_speed product_length line_speed sample_rate counts_per_kg '
        'zero_counts zero zero_std_dev first_index first_stamp empty_begin window_begin '
        'window_end counts denoised reasons'
    ),
    'ZeroSetting': 'header zero previous std_dev',
    'MassEstimate': (
        'header item_id t1 t2 t3 status reasons mass std_dev zero belt_speed product_length '
        'line_speed estimator a1 a2 b1 natural_frequency damping_ratio'
    ),
    'Verdict': (
        'header item_id estimate_id t1 decision reasons mass std_dev lower_limit upper_limit '
        'reject_at late product batch batch_items batch_accepted batch_below_tu1 batch_surplus'
    ),
    'ExternalReject': 'header device item_id text',
    'MachineConditions': 'header known conditions inputs',
    'StopRequest': 'header state reason hint item_id',
    'ProductOnLine': (
        'header product batch needed lower_limit upper_limit min_length max_length min_speed '
        'max_speed nominal tu1 tu1_quota mean_value performance_test batch_items batch_accepted '
        'batch_below_tu1 batch_surplus'
    ),
    'PerformanceTest': (
        'header state product batch text who due stop_at last mass limit passes errors'
    ),
    'Statistics': (
        'header product batch items accepted under over faults reasons reason_counts '
        'length_faults speed_faults nominal tare mean std_dev giveaway tu1 tu2 below_tu1 '
        'below_tu2 share_below_tu1 throughput'
    ),
    'FillerFeedback': 'header product item_id items target median step correction limited',
    'Alarms': 'header alarms',
    'BatchResult': 'header batch record sha256',
    'VerificationStep': 'header step state begin text',
}


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


@pytest.mark.parametrize('lacking', [('station_at',), ('station', 'station_at')])
def test_a_verdict_from_before_some_fields_came_is_still_read(tmp_path, lacking):
    bag_with_verdict(tmp_path / 'older', *lacking)

    (verdict,) = read_records(tmp_path / 'older', VERDICT)[VERDICT.name]

    assert verdict.station_at is None
    assert (verdict.item_id, verdict.t3, verdict.decision) == (7, 5, 3)
    assert verdict.station == (0 if 'station' in lacking else 2)


def test_a_verdict_that_lacks_another_field_is_refused(tmp_path):
    bag_with_verdict(tmp_path / 'foreign', 'mass')

    with pytest.raises(BagError, match='another definition'):
        read_records(tmp_path / 'foreign', VERDICT)


@pytest.mark.parametrize('port', [port for port in RECORDED if port.record], ids=lambda p: p.name)
def test_a_field_that_the_first_version_lacks_is_a_newer_one(port):
    """A new field of a record has its default from `newer`, or older bags are refused."""
    fields = [name for name, _ in typestore([port]).fielddefs[port.message_type][1]]
    first = [name for name in fields if name not in newer_fields(port.record)]
    assert first == FIRST_FIELDS[port.message_type.rpartition('/')[2]].split()
