# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Replay by the graph over real DDS, with the same rows as offline to the last bit."""

from pathlib import Path
import subprocess
import sys

from foreign_bags import messages_of, write_split
from lines import edges_of, saturated_at, simulated, without_block_at, without_edges, write_line
import pytest
from rclpy.node import Node
from rosbags.rosbag2 import CompressionMode
from running import BAGS, PATIENCE, Rows, run_command, wait_for

from checkweigher_bringup.spinning import spinning
from checkweigher_core.records import NANOSECONDS
from checkweigher_recording.bags.reading import read_bag


@pytest.fixture(scope='module')
def faulty_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag in which every second item cannot be weighed, for different reasons."""
    line = simulated(speed=1.0, count=12)
    edges = [edges_of(line, item) for item in range(12)]
    lost = (edges[1]['t2'], edges[3]['t3'], edges[9]['t1'], edges[10]['t4'], edges[11]['t3'])
    line = without_edges(line, *lost)
    line = without_block_at(line, edges[5]['t2'].stamp + NANOSECONDS // 20)
    line = saturated_at(line, edges[7]['t2'].stamp + NANOSECONDS // 20)
    return write_line(tmp_path_factory.mktemp('faulty') / 'bag', line)


@pytest.mark.parametrize(
    ('name', 'options'),
    [('paper_60', ('--rate', '0')), ('paper_75', ('--rate', '20', '--namespace', 'lane1'))],
)
def test_a_replay_gives_the_same_rows_as_offline(rows: Rows, name: str, options: tuple[str, ...]):
    offline = rows('weigh', BAGS / name)
    assert rows('replay', BAGS / name, *options) == offline
    assert len(offline) == 25


def test_a_bag_that_rosbag2_split_and_compressed_is_replayed(rows: Rows, tmp_path: Path):
    messages = messages_of(read_bag(BAGS / 'paper_90'))
    bag = write_split(tmp_path / 'split', messages, CompressionMode.FILE)
    assert rows('replay', bag, '--rate', '0') == rows('weigh', BAGS / 'paper_90')


def test_every_item_has_one_verdict_and_what_cannot_be_weighed_its_reason(
    rows: Rows, faulty_bag: Path
):
    weighed = rows('weigh', faulty_bag)
    for flags in ((), ('--processes',)):
        assert rows('replay', faulty_bag, '--rate', '0', *flags) == weighed
    assert [int(row['item_id']) for row in weighed] == list(range(1, 13))
    reasons = {int(row['item_id']): row['reasons'] for row in weighed if row['reasons']}
    assert reasons == {
        2: 'ProductTooLong;MissingEdge',  # at t3 nobody can tell which
        4: 'MissingEdge',
        6: 'SamplesLost',
        8: 'Saturation',
        10: 'MissingEdge',
        12: 'MissingEdge',
    }
    for row in weighed:
        assert (row['decision'] == 'FAULT') == bool(row['reasons'])
        assert (row['mass_g'] == '') == bool(row['reasons'])


def test_parameters_reach_the_graph_as_they_reach_offline(rows: Rows, tmp_path: Path):
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(
        '/**:\n  ros__parameters:\n    lower_limit: 0.1\n    upper_limit: 0.2\n'
        '/**/identifier:\n  ros__parameters:\n    iswd_eksi:\n      rise_noise: [1000.0]\n'
        '/**/reject:\n  ros__parameters:\n    tu1: 0.14\n    tu1_quota: 0.3\n'
    )
    bag = BAGS / 'paper_60'
    offline = rows('weigh', bag, '--params', parameters)
    assert rows('replay', bag, '--rate', '0', '--params', parameters) == offline
    decisions: dict[str, str] = {}
    for row in offline:
        decisions[row['reference_g']] = decisions.get(row['reference_g'], '') + row['decision'][0]
    assert decisions == {
        '74.500000': 'UUUUU',
        # 1 of 1 and 1 of 3 below TU1 would be too many; 1 of 5, 2 of 8 and 3 of 11 are not.
        '134.500000': 'UUAAA',
        '164.500000': 'AAAAA',
        '194.500000': 'AAAAA',
        '254.500000': 'OOOOO',
    }
    assert [row['reasons'] for row in offline if row['reasons']] == 2 * ['TU1Quota']
    assert [row['mass_g'] for row in offline] != [row['mass_g'] for row in rows('weigh', bag)]


def test_a_second_driver_on_the_same_topics_is_refused():
    driver = subprocess.Popen(
        [
            *(sys.executable, '-m', 'checkweigher_driver.driver_node', '--ros-args'),
            *('-r', '__ns:=/taken', '-p', 'lossless:=false', '-p', 'simulator.count:=0'),
        ]
    )
    try:
        with spinning('taken') as spinner:
            node = Node('observer')
            spinner.add(node)
            wait_for(lambda: node.count_publishers('/taken/load_cell/samples'), 'the driver')
        done = run_command('replay', BAGS / 'paper_30', '--namespace', 'taken')
    finally:
        driver.terminate()
        driver.wait(timeout=PATIENCE)
    assert done.returncode == 2
    # Its place is known at once, its topics as soon as DDS shows them; where DDS is slow, the nodes
    # may have said something before.
    last_line = done.stderr.strip().splitlines()[-1]
    said = '/taken/driver runs here already', 'something else publishes /taken/load_cell/samples'
    assert any(text in last_line for text in said)
    assert 'ACCEPT' not in done.stdout


def test_what_is_learned_on_the_way_is_the_same_in_the_graph(rows: Rows, tmp_path: Path):
    line = simulated(profile='machine:206', speed=1.0, count=40, masses=(0.1645,))
    bag = write_line(tmp_path / 'bag', line)
    record = tmp_path / 'of a line'
    record.write_text('that replay must neither read nor write')
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(
        f'/**/identifier: {{ros__parameters: {{learn: true, learning: {{record: {record}}}}}}}'
    )

    learned = rows('weigh', bag, '--params', parameters)

    assert rows('replay', bag, '--rate', '0', '--params', parameters) == learned
    assert record.read_text().startswith('that replay')
    plain = rows('weigh', bag)
    assert learned[:30] == plain[:30]
    assert all(a['mass_g'] != b['mass_g'] for a, b in zip(learned[30:], plain[30:], strict=True))
