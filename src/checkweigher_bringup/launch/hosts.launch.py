# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Start the share that one host has of a line over several hosts: see docs/hosts.md."""

from pathlib import Path
from tempfile import NamedTemporaryFile

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from checkweigher_bringup.hosts.description import read_line
from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_bringup.supervision import CANNOT_START
from checkweigher_dsp.ros.access.enclave import enclave_arguments

RESPAWN_DELAY = 1.0  # s

_files = []  # which go when launch ends

ARGUMENTS = (
    ('line', 'description of the line (YAML)'),
    ('host', 'name of this host in it'),
)


def generate_launch_description():
    """Return the arguments and the share."""
    arguments = [DeclareLaunchArgument(name, description=text) for name, text in ARGUMENTS]
    return LaunchDescription([*arguments, OpaqueFunction(function=make_share)])


def make_share(context):
    """Return the processes of the host, and the environment in which they find the others."""
    path, host = (LaunchConfiguration(name).perform(context) for name, _ in ARGUMENTS)
    line = read_line(Path(path))
    variables = [SetEnvironmentVariable(*each) for each in line.environment().items()]
    return [*variables, *map(make_process, line.shares(host)), make_supervisor(path, host)]


def make_process(share):
    """Return the process of a share."""
    return Node(
        package='checkweigher_bringup', executable='line', namespace=share.lane,
        arguments=list(share.nodes), parameters=[*map(str, share.params), own_file(share)],
        ros_arguments=enclave_arguments(share.lane, 'line'),
        output='screen', respawn=True, respawn_delay=RESPAWN_DELAY, on_exit=on_exit,
    )  # fmt: skip


def make_supervisor(path, host):
    """Return what compares the clock of this host with those that share a lane with it."""
    return Node(
        package='checkweigher_bringup', executable='supervisor',
        arguments=[str(Path(path).absolute()), host],
        output='screen', respawn=True, respawn_delay=RESPAWN_DELAY, on_exit=on_exit,
    )  # fmt: skip


def own_file(share):
    """Return a file with the parameters that the description itself has, while launch runs."""
    file = NamedTemporaryFile(suffix='.yaml')  # noqa: SIM115
    _files.append(file)
    write_parameter_file(Path(file.name), {'product': share.product})
    return file.name


def on_exit(event, context):
    """End the launch when a process cannot start: its lane would give no verdicts."""
    if event.returncode == CANNOT_START:
        return [Shutdown(reason=f'{event.process_name} cannot start; its message is above')]
    return []
