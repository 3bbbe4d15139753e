# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hosts that are none of the line: whom they find, and who finds them."""

import json
import subprocess
import sys

from network import Network, NoNetworkError, network
import pytest
from running import PATIENCE

LINE = '10.75.0.1;10.75.0.2'  # hosts 0 and 1
# A node that tells whom it has found, once it has found all of some and has looked for longer.
NODE = """
import json, sys, time
import checkweigher_dsp.ros
import rclpy
own, wanted, longer = sys.argv[1], set(sys.argv[2].split()), float(sys.argv[3])
rclpy.init()
node = rclpy.create_node(own)
found = set()
while not wanted <= (found := found | set(node.get_node_names())):
    time.sleep(0.05)
time.sleep(longer)  # two periods of announcements, in which others might come
print(json.dumps(sorted(found | set(node.get_node_names()))), flush=True)
sys.stdin.read()
"""
TWO_PERIODS = 6.5  # s


class Nodes:
    """Nodes of a name each, on hosts with an environment each."""

    def __init__(self, hosts: Network) -> None:
        self._hosts = hosts
        self._nodes: dict[str, subprocess.Popen[str]] = {}

    def start(self, name: str, host: int, wanted: str, longer: float = 0.0, **env: str) -> None:
        words = [*self._hosts.command(host, **env), sys.executable, '-c', NODE, name, wanted]
        pipe = subprocess.PIPE
        self._nodes[name] = subprocess.Popen(
            [*words, str(longer)], stdin=pipe, stdout=pipe, text=True
        )

    def found(self, name: str) -> set[str]:
        output = self._nodes[name].stdout
        assert output is not None
        return set(json.loads(output.readline()))

    def end(self) -> None:
        for node in self._nodes.values():
            node.terminate()
        for node in self._nodes.values():
            node.communicate(timeout=PATIENCE)


def named(peers: str) -> dict[str, str]:
    return {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST', 'ROS_STATIC_PEERS': peers}


def test_a_host_that_is_not_named_finds_nobody_and_one_that_calls_on_the_line_does():
    try:
        with network(3) as hosts:
            nodes = Nodes(hosts)
            try:
                alone = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
                nodes.start('alone', 0, 'alone', **alone)  # as everything starts by default
                nodes.start('closed', 0, 'closed other', **named(LINE))
                nodes.start('other', 1, 'closed other', **named(LINE))
                nodes.start('open', 0, 'open')
                assert 'closed' in nodes.found('other')
                assert 'open' in nodes.found('open')
                nodes.start('stranger', 2, 'open', TWO_PERIODS)
                assert nodes.found('stranger') == {'open', 'stranger'}
                # Discovery is no lock: who knows the address and calls on it is heard.
                nodes.start('caller', 2, 'closed', **named('10.75.0.1'))
                assert 'closed' in nodes.found('caller')
            finally:
                nodes.end()
    except NoNetworkError as error:
        pytest.skip(str(error))
