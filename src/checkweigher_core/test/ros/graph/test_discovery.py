# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from running import PATIENCE

from checkweigher_core.ros.graph import discovery
from checkweigher_core.ros.graph.discovery import PARTICIPANTS, peers, profiles, set_profiles

LOCAL = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_DOMAIN_ID': '3'}
# Program with a node that prints a line when it has discovered a given number of nodes. The program
# runs until it is terminated.
NODE = """
import sys, time
import checkweigher_core.ros
import rclpy
rclpy.init()
node = rclpy.create_node(f'number_{sys.argv[1]}')
while len(node.get_node_names()) < int(sys.argv[2]):
    time.sleep(0.05)
print('all', flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize('home', [None, '/nonexistent'])
def test_a_user_without_a_home_has_a_context(tmp_path: Path, home: str | None):
    program = 'import checkweigher_core.ros, rclpy; rclpy.init(); rclpy.try_shutdown()'
    env = {name: value for name, value in os.environ.items() if name not in ('HOME', 'ROS_HOME')}
    env |= {'TMPDIR': str(tmp_path)} | ({'HOME': home} if home else {})
    done = subprocess.run([sys.executable, '-c', program], env=env, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, '')
    assert (tmp_path / f'checkweigher-{os.geteuid()}/log').is_dir()


def test_the_ports_are_those_of_rtps():
    # Constants of RTPS 2.5, 9.6.2.3: PB is 7400, DG is 250, d1 is 10, and PG is 2.
    called = peers(LOCAL)
    assert called[0] == ('127.0.0.1', 7400 + 250 * 3 + 10)
    assert called[5] == ('127.0.0.1', 7400 + 250 * 3 + 10 + 2 * 5)
    assert len(called) == PARTICIPANTS


def test_named_hosts_are_called_on_as_well():
    called = peers({**LOCAL, 'ROS_STATIC_PEERS': '10.0.0.7;;press.local;127.0.0.1'})
    assert {address for address, _ in called} == {'127.0.0.1', '10.0.0.7'}


def test_where_there_is_multicast_nobody_is_called_on():
    assert not peers({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'})
    assert 'initialPeersList' not in profiles({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'})


def test_the_profiles_are_xml():
    root = ElementTree.fromstring(profiles(LOCAL))
    called = next(each for each in root.iter() if each.tag.endswith('}initialPeersList'))
    assert len(called) == PARTICIPANTS
    assert sum(each.tag.endswith('}subscriber') for each in root) == 1


@pytest.mark.parametrize('discovery_range', ['LOCALHOST', 'SUBNET'])
def test_a_process_hears_nothing_by_memory_that_others_can_lose(discovery_range: str):
    words = [sys.executable, '-c', NODE, '0', '1']
    environment = {**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': discovery_range}
    with subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as node:
        assert node.stdin is not None
        assert node.stdout is not None
        assert node.stdout.readline() == 'all\n'
        opened = [str(each.readlink()) for each in Path(f'/proc/{node.pid}/fd').iterdir()]
        node.stdin.close()
    assert any('socket' in each for each in opened)
    assert not [each for each in opened if 'fastrtps_port' in each]


def test_who_has_profiles_keeps_them(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv('FASTRTPS_DEFAULT_PROFILES_FILE', '/etc/own.xml')
    set_profiles()
    assert discovery.os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] == '/etc/own.xml'


def test_a_folder_of_somebody_else_is_not_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    (tmp_path / 'link').symlink_to(tmp_path)
    monkeypatch.setattr(discovery, '_FOLDER', tmp_path / 'link')
    monkeypatch.delenv('FASTRTPS_DEFAULT_PROFILES_FILE')
    set_profiles()
    used = Path(discovery.os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'])
    assert used.name == 'fastdds_profiles.xml'


def test_ten_processes_of_a_computer_find_each_other():
    count = 10  # without the profiles, Fast DDS contacts only four participants
    words = [sys.executable, '-c', NODE]
    nodes = [
        subprocess.Popen(
            [*words, str(number), str(count)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True,
        )
        for number in range(count)
    ]  # fmt: skip
    try:
        for node in nodes:
            assert node.stdout is not None
            assert node.stdout.readline() == 'all\n'
    finally:
        for node in nodes:
            node.terminate()
        for node in nodes:
            node.communicate(timeout=PATIENCE)
