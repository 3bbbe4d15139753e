"""Start the checkweigher line: driver, segmenter, denoise, identifier and reject.

The arguments set what differs from run to run; everything else is in the parameter file.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

# Each stage with its package; the executable has the name of the node.
STAGES = {
    'segmenter': 'checkweigher_dsp',
    'denoise': 'checkweigher_dsp',
    'identifier': 'checkweigher_dsp',
    'reject': 'checkweigher_dsp',
    'driver': 'checkweigher_driver',
}


def generate_launch_description():
    """Return the line, in one process or in one for each node."""
    one_process = LaunchConfiguration('one_process')
    common = {
        'namespace': LaunchConfiguration('namespace'),
        'output': 'screen',
    }
    parameters = [
        LaunchConfiguration('params_file'),
        {
            'source': LaunchConfiguration('source'),
            'rate': ParameterValue(LaunchConfiguration('rate'), value_type=float),
            'bag.path': ParameterValue(LaunchConfiguration('bag'), value_type=str),
        },
    ]
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='of the lane'),
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution(
                    [FindPackageShare('checkweigher_bringup'), 'config', 'line.yaml']
                ),
                description='parameters of all nodes',
            ),
            DeclareLaunchArgument(
                'source', default_value='simulator', description='simulator or bag'
            ),
            DeclareLaunchArgument(
                'bag', default_value='', description='bag to play with source:=bag'
            ),
            DeclareLaunchArgument(
                'rate',
                default_value='1.0',
                description='pace of a bag or of the simulator; 0 as fast as nothing is lost',
            ),
            DeclareLaunchArgument(
                'one_process',
                default_value='true',
                description='whether all nodes share one process; false gives each its own',
            ),
            Node(
                package='checkweigher_bringup',
                executable='line',
                parameters=parameters,
                condition=IfCondition(one_process),
                **common,
            ),
            *(
                Node(
                    package=package,
                    executable=name,
                    name=name,
                    parameters=parameters if name == 'driver' else parameters[:1],
                    condition=UnlessCondition(one_process),
                    **common,
                )
                for name, package in STAGES.items()
            ),
        ]
    )
