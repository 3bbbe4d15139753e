# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameter sets as parameters of a node: what a parameter file gives them."""

from pathlib import Path

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from checkweigher_core.ros.node_parameters import declare
from checkweigher_dsp.rejection.parameters import RejectParameters


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('inspections: ""\n    inspection_distances: []\n    inspection_times: []', ()),
        (
            'inspections: metal\n    inspection_distances: [0.6]\n    inspection_times: [0.1]',
            (0.6,),
        ),
        ('max_rejects_in_a_row: 3', ()),
    ],
)
def test_a_list_that_is_empty_by_default_is_taken_from_a_file(
    process: object, tmp_path: Path, text: str, expected: tuple[float, ...]
):
    file = tmp_path / 'line.yaml'
    file.write_text(f'/**/reject:\n  ros__parameters:\n    {text}\n')
    node = Node('reject', cli_args=['--ros-args', '--params-file', str(file)])
    try:
        assert declare(node, RejectParameters, read_only=False).inspection_distances == expected
        for value in ([0.5, 0.7], []):
            name = 'inspection_distances'
            assert node.set_parameters([Parameter(name, value=value)])[0].successful
            assert list(node.get_parameter(name).value) == value
    finally:
        node.destroy_node()
