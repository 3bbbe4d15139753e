# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a running line, written to a file and read as by `ros2 param dump` and `load`."""

from collections.abc import Iterator
from contextlib import contextmanager
import math
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from running import PATIENCE, wait_for
import yaml

from checkweigher_bringup.spinning import Spinner, node_command, running_processes
from checkweigher_core.ros.ports import NODES

LANE = 'parameter_files'
CHANGED = """
/**/reject:
  ros__parameters:
    lower_limit: 0.123
    stations: UNDER
    station_distances: [1.5]
    station_delays: [0.00001]
/**/segmenter:
  ros__parameters:
    zero_random_walk: 0.00002
"""


class Reader(Node):
    """Node that reads and sets the parameters of the line as the ROS tools do."""

    def ask(self, future: Any) -> Any:
        wait_for(future.done)
        return future.result()

    def client(self, name: str) -> AsyncParameterClient:
        client = AsyncParameterClient(self, f'/{LANE}/{name}')
        assert client.wait_for_services(PATIENCE)
        return client

    def values(self, name: str) -> dict[str, Any]:
        client = self.client(name)
        names = sorted(self.ask(client.list_parameters()).result.names)
        found = self.ask(client.get_parameters(names)).values
        values = map(parameter_value_to_python, found)
        # As ros2param does it.
        return {
            key: value if isinstance(value, (bool, float, int, str)) else list(value)
            for key, value in zip(names, values, strict=True)
        }


@contextmanager
def line(*files: Path) -> Iterator[None]:
    command = node_command('checkweigher_bringup.line', LANE, *files)
    with running_processes({'line': command}):
        yield


def test_each_value_of_each_node_comes_back(tmp_path: Path, spinner: Spinner):
    reader = Reader('reader')
    spinner.add(reader)
    given = tmp_path / 'given.yaml'
    given.write_text(CHANGED)
    dumps = []
    with line(given):
        before = {name: reader.values(name) for name in NODES}
        for name, values in before.items():
            dumps.append(tmp_path / f'{name}.yaml')
            content = {f'/{LANE}/{name}': {'ros__parameters': values}}
            dumps[-1].write_text(yaml.dump(content, default_flow_style=False))
            loaded = reader.ask(reader.client(name).load_parameter_file(str(dumps[-1]), True))
            refused = [each.reason for each in loaded.results if not each.successful]
            assert not refused, name
        assert {name: reader.values(name) for name in NODES} == before
    with line(*dumps):
        assert {name: reader.values(name) for name in NODES} == before
    reject = before['reject']
    assert (reject['lower_limit'], reject['upper_limit']) == (0.123, math.inf)
    assert (reject['station_delays'], reject['inspection_times']) == ([0.00001], [])
