# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that the project writes: the same bytes, all or nothing, and what ROS tools expect."""

import errno
import os

from foreign_bags import same
from full_disk import file_size_limit
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import pytest
from rosbags.interfaces import QosDurability, QosReliability
from rosbags.rosbag2 import Reader
import yaml

from checkweigher_core.records import NANOSECONDS
from checkweigher_core.ros.ports import PLAYED
from checkweigher_core.whole_file import OutputError
from checkweigher_recording.bags.definitions import typestore
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters


def _files(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_what_is_written_is_read(bag, recording):
    assert same(read_bag(bag), recording)
    assert same(read_bag(bag / 'line_0.mcap'), recording)


def test_equal_events_give_equal_bytes_under_any_name(tmp_path):
    parameters = SimulationParameters(count=3)
    for name in ('one', 'another'):
        simulation = Simulation(parameters)
        write_bag(tmp_path / name, simulation.load_cell, simulation)

    assert _files(tmp_path / 'one') == _files(tmp_path / 'another')


def test_nothing_else_appears_beside_the_bag(tmp_path, bag):
    assert [path.name for path in tmp_path.iterdir()] == ['bag']
    assert sorted(_files(bag)) == ['line_0.mcap', 'metadata.yaml']
    ordinary = tmp_path / 'ordinary'
    ordinary.mkdir()
    assert bag.stat().st_mode == ordinary.stat().st_mode


def test_foxglove_reads_the_messages_from_the_bag_alone(bag, recording):
    read = {port.name: [] for port in PLAYED}
    with (bag / 'line_0.mcap').open('rb') as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            read[channel.topic.strip('/')].append(message)

    (cell,) = read['load_cell/info']
    assert cell.counts_per_kg == recording.load_cell.counts_per_kg
    assert [(block.first_index, list(block.counts)) for block in read['load_cell/samples']] == [
        (block.first_index, block.counts.tolist()) for block in recording.blocks
    ]
    edges = [(_ns(edge.header.stamp), edge.eye, edge.blocked) for edge in read['photo_eyes']]
    assert edges == [(edge.stamp, edge.eye, edge.blocked) for edge in recording.edges]
    masses = [(_ns(each.header.stamp), each.mass) for each in read['reference_mass']]
    assert masses == [(each.stamp, each.mass) for each in recording.references]


def _ns(stamp):
    return stamp.sec * NANOSECONDS + stamp.nanosec


def test_a_bag_describes_itself(tmp_path, recording):
    write_bag(tmp_path / 'bag', recording.load_cell, recording, namespace='lane1')

    with Reader(tmp_path / 'bag') as reader:
        connections = {connection.topic: connection for connection in reader.connections}
        assert set(connections) == {f'/lane1/{port.name}' for port in PLAYED}
        assert reader.start_time == recording.blocks[0].stamp
        assert reader.duration == recording.blocks[-1].stamp - recording.blocks[0].stamp + 1
        for port in PLAYED:
            connection = connections[f'/lane1/{port.name}']
            assert connection.msgtype == port.message_type
            assert connection.digest == typestore().hash_rihs01(port.message_type)
            (qos,) = connection.ext.offered_qos_profiles
            assert qos.reliability is QosReliability.RELIABLE
            assert (qos.durability is QosDurability.TRANSIENT_LOCAL) == port.history.latched
            assert (qos.depth == 1) == port.history.latched
        assert connections['/lane1/load_cell/info'].msgcount == 1


def test_metadata_and_log_times_agree_with_the_events(bag, recording):
    stated = yaml.safe_load((bag / 'metadata.yaml').read_text())
    with (bag / 'line_0.mcap').open('rb') as file:
        reader = make_reader(file)
        header, (record,) = reader.get_header(), reader.iter_metadata()
        times = [message.log_time for _, _, message in reader.iter_messages()]

    # The version of the library is not in the file.
    assert (header.profile, header.library) == ('ros2', 'checkweigher')
    information = stated['rosbag2_bagfile_information']
    assert yaml.safe_load(record.metadata['serialized_metadata']) == information
    stamps = sorted(event.stamp for event in recording)
    assert times == [stamps[0], *stamps]
    assert information['message_count'] == len(times)


def test_25_products_take_little_room(tmp_path):
    simulation = Simulation(SimulationParameters(speed=0.5, count=25))
    write_bag(tmp_path / 'bag', simulation.load_cell, simulation)

    assert sum(map(len, _files(tmp_path / 'bag').values())) < 400_000


def test_after_an_error_nothing_stays_behind(tmp_path, recording):
    def broken():
        yield from list(recording)[:50]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_bag(tmp_path / 'bag', recording.load_cell, broken())
    assert not list(tmp_path.iterdir())


def test_a_bag_without_events_is_not_written(tmp_path, recording):
    with pytest.raises(OutputError, match='there is nothing to write'):
        write_bag(tmp_path / 'bag', recording.load_cell, [])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('make', ['folder', 'file', 'link'])
def test_what_exists_is_not_overwritten(tmp_path, recording, make):
    path = tmp_path / 'bag'
    if make == 'folder':
        path.mkdir()
    elif make == 'file':
        path.write_text('kept')
    else:
        path.symlink_to(tmp_path / 'nowhere')

    with pytest.raises(OutputError, match='exists already') as caught:
        write_bag(path, recording.load_cell, recording)
    assert '\n' not in str(caught.value)
    assert os.listdir(tmp_path) == ['bag']


@pytest.mark.parametrize(
    ('parent', 'message'),
    [
        ('none', 'there is no folder'),
        ('file', 'there is no folder'),
        # For root every other folder is writable.
        ('/proc/self', 'read-only|cannot be written'),
    ],
)
def test_a_parent_that_takes_no_folder_is_refused(tmp_path, recording, parent, message):
    (tmp_path / 'file').write_text('')
    with pytest.raises(OutputError, match=message):
        write_bag(tmp_path / parent / 'bag', recording.load_cell, recording)


def test_a_full_disk_is_one_line(tmp_path, recording):
    with file_size_limit(4096), pytest.raises(OutputError) as caught:
        write_bag(tmp_path / 'bag', recording.load_cell, recording)
    text = str(caught.value)
    assert text.startswith(f'{tmp_path / "bag"}: ')
    assert os.strerror(errno.EFBIG) in text
    assert '\n' not in text
    assert not list(tmp_path.iterdir())
