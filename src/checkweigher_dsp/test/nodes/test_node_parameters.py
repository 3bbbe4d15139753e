# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameter sets as parameters of a node: what a parameter file gives them."""

import math
from pathlib import Path

import pytest
from rcl_interfaces.msg import Parameter as ParameterMessage
from rclpy.node import Node
from rclpy.parameter import Parameter, get_parameter_value

from checkweigher_core.ros.node_parameters import as_declared, declare
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


@pytest.mark.parametrize(
    ('declared', 'text', 'value'),
    [
        (1.0, '2', 2.0),
        (1.0, 'inf', math.inf),
        (1.0, '1e-05', 1e-05),
        ([1.0], '[]', []),
        ([1.0], '[1, 2]', [1.0, 2.0]),
        ([1.0], '[1e-05, 2e-05]', [1e-05, 2e-05]),
        ([1.0], '[1e-05, 0.5]', [1e-05, 0.5]),
    ],
)
def test_a_number_is_taken_as_the_tools_guess_it(declared: object, text: str, value: object):
    before = Parameter('limit', value=declared)
    change = as_declared(before, guessed(text))
    assert (change.type_, change.value) == (before.type_, value)


@pytest.mark.parametrize('text', ['heavy', 'true', '[1.0]', '[heavy]'])
def test_what_is_no_number_stays_what_it_is(text: str):
    change = guessed(text)
    assert as_declared(Parameter('limit', value=1.0), change) is change


def guessed(text: str) -> Parameter:
    """Return a parameter as `ros2 param set` guesses it from a text."""
    message = ParameterMessage(name='limit', value=get_parameter_value(text))
    return Parameter.from_parameter_msg(message)
