# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Launch file of the released packages: the six nodes of a lane, one process each.

This launch file needs only packages that apt provides. `line.launch.py` of checkweigher_bringup has
more arguments.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from checkweigher_core.parent_process import CANNOT_START, child_variable
from checkweigher_core.ros.graph.policy import enclave_arguments
from checkweigher_core.ros.ports import NODES

RESPAWN_DELAY = 1.0  # s


def generate_launch_description():
    """Return the launch arguments, and the action that starts the nodes."""
    return LaunchDescription(
        [
            DeclareLaunchArgument('params_file', description='ROS parameter file of all nodes'),
            DeclareLaunchArgument(
                'namespace', default_value='', description='namespace of the lane; empty for none'
            ),
            OpaqueFunction(function=make_nodes),
        ]
    )


def make_nodes(context):
    """Return the actions that start the nodes."""
    names = ('params_file', 'namespace')
    file, namespace = (LaunchConfiguration(name).perform(context) for name in names)
    # For a missing file, launch would only print a warning and start the nodes with the defaults.
    if not Path(file).is_file():
        raise RuntimeError(f'params_file: there is no file {file}')
    return [
        Node(
            package=module.partition('.')[0],
            executable=name,
            name=name,
            namespace=namespace,
            parameters=[file],
            ros_arguments=enclave_arguments(namespace.strip('/'), name),
            additional_env=child_variable(),
            output='screen',
            respawn=True,
            respawn_delay=RESPAWN_DELAY,
            on_exit=end_if_it_cannot_start,
        )
        for name, module in NODES.items()
    ]


def end_if_it_cannot_start(event, context):
    """End the launch if a node cannot start.

    Otherwise the node would be started again each second, and its error message would be repeated.
    """
    if event.returncode == CANNOT_START:
        return [Shutdown(reason=f'{event.process_name} cannot start; its message is above')]
    return []
