# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Launch file of the line: driver, segmenter, denoise, identifier, reject and product.

The arguments set the values that differ from run to run. All other values, and the values of
omitted arguments, come from the parameter file. With lanes:=FILE host:=NAME, only the nodes of the
host NAME start. FILE describes lanes on several hosts, see docs/hosts.md.
"""

from functools import partial
from pathlib import Path
from tempfile import NamedTemporaryFile

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable, Shutdown
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch.utilities import normalize_to_list_of_substitutions, perform_substitutions
from launch.utilities.type_utils import normalize_typed_substitution, perform_typed_substitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from checkweigher_bringup.commissioning.machine_folder import DEFAULTS as OF_FOLDER
from checkweigher_bringup.commissioning.machine_folder import MachineFolder
from checkweigher_bringup.hosts.description import read_line
from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_core.parent_process import CANNOT_START, child_variable
from checkweigher_core.ros.graph.policy import enclave_arguments
from checkweigher_core.ros.ports import NODES
from checkweigher_core.ros.services import OF_MACHINE
from checkweigher_gateways.settings import read_gateways
from checkweigher_web.access.site import Site

RESPAWN_DELAY = 1.0  # s
LOG_LEVEL = ['--log-level', LaunchConfiguration('log_level')]

# Temporary files, which are removed when launch ends.
_files = []

# Defaults of the arguments. The default of any other argument is ''.
DEFAULTS = {
    'params_file': PathJoinSubstitution(
        [FindPackageShare('checkweigher_bringup'), 'config', 'line.yaml']
    ),
    'one_process': 'true',
    'respawn': 'true',
    'page': 'false',
    'batch_reports': 'false',
    'log_level': 'info',
}
ARGUMENTS = {
    'namespace': 'namespace of the lane',
    'params_file': 'parameter file of all nodes',
    'source': 'simulator, bag, aed or ascii; empty: bag with bag:=..., else as in params_file',
    'bag': 'bag to replay',
    'rate': 'speed of a bag or of the simulator relative to real time; 0: as fast as possible; '
    'empty: as in params_file',
    'one_process': 'whether all nodes share one process; false: one process for each node',
    'remap': 'remapping rules NODE:TOPIC:=OTHER, separated by spaces, to insert your own node',
    'respawn': 'whether processes that end are restarted; false: if a process of the line ends, '
    'the launch ends, too',
    'folder': 'folder of this machine with calibration, trained parameters, recipes and audit log; '
    'created if necessary; the nodes dynamic_setting and verifier then also run',
    'page': 'whether the web page of the line is served, at http://127.0.0.1:8080/',
    'page_host': 'address of the page; any other than 127.0.0.1 needs TLS',
    'page_certificate': 'certificate file of the page for TLS (PEM)',
    'page_key': 'key file of this certificate (PEM)',
    'batch_reports': 'whether a report is written beside the record of each batch that ends',
    'gateways': 'settings file of the gateways (YAML); a gateway runs for each section',
    'lanes': 'description of lanes on several hosts (YAML), which replaces the arguments above '
    'except respawn, page, page_... and gateways',
    'host': 'name of this host in the file lanes',
    'log_level': 'lowest severity that the nodes log: debug, info, warn, error or fatal',
}
PAGE_OPTIONS = {'host': str, 'certificate': Path, 'key': Path}
WITH_LANES = (
    *('respawn', 'page', *(f'page_{name}' for name in PAGE_OPTIONS), 'gateways'),
    *('lanes', 'host', 'log_level'),
)


def generate_launch_description():
    """Return the description of the launch, which contains its arguments and the line."""
    arguments = [
        DeclareLaunchArgument(name, default_value=DEFAULTS.get(name, ''), description=text)
        for name, text in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=make_line)])


def make_line(context):
    """Return the actions that start the line, or the nodes of one host."""
    lanes, host = (LaunchConfiguration(name).perform(context) for name in ('lanes', 'host'))
    if lanes or host:
        return make_host(context, lanes, host)
    params_file = LaunchConfiguration('params_file').perform(context)
    # Check that the file exists, because launch would only print a warning, and would start the
    # line with the defaults.
    if not Path(params_file).is_file():
        raise RuntimeError(f'params_file: there is no file {params_file}')
    one_process = LaunchConfiguration('one_process')
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    kept = kept_running(context)
    folder = LaunchConfiguration('folder').perform(context)
    common_ros = [*LOG_LEVEL, *remap_arguments(context)]
    files = parameter_files(context, Path(params_file), folder, namespace)

    def node(executable, condition, package='checkweigher_bringup', **options):
        # The action is not a LifecycleNode, because `driver` and `reject` activate themselves. A
        # LifecycleNode with autostart is activated only once, and not after a respawn.
        return Node(
            package=package,
            executable=executable,
            namespace=namespace,
            parameters=files,
            ros_arguments=[*common_ros, *enclave_arguments(namespace, executable)],
            condition=condition,
            **kept,
            **options,
        )

    ends = partial(on_exit, respawn=kept['respawn'])
    apart = UnlessCondition(one_process)
    return [
        node('line', IfCondition(one_process), on_exit=ends),
        *(
            node(name, apart, module.partition('.')[0], name=name, on_exit=ends)
            for name, module in NODES.items()
        ),
        *(node(name, None) for name in OF_MACHINE if folder),
        *make_page(context, kept),
        *make_gateways(context, kept),
        node('batch_reporter', IfCondition(LaunchConfiguration('batch_reports'))),
    ]


def remap_arguments(context):
    """Return the ROS arguments for the rules of the argument `remap`."""
    rules = LaunchConfiguration('remap').perform(context).split()
    for rule in rules:
        node, _, names = rule.partition(':')
        # ROS would ignore an unknown node, and the line would run without the node of the user.
        if node not in NODES or not all(names.partition(':=')):
            known = ', '.join(NODES)
            raise RuntimeError(f'remap: {rule!r} is not NODE:TOPIC:=OTHER; NODE is one of {known}')
    return [word for rule in rules for word in ('--remap', rule)]


def make_host(context, lanes, host):
    """Return the actions that start the nodes of one host, with one process for each lane."""
    if not (lanes and host):
        raise RuntimeError(
            f'lanes:={lanes} host:={host}: give both: a file of hosts, and the name of a host in it'
        )
    for name in (each for each in ARGUMENTS if each not in WITH_LANES):
        default = normalize_to_list_of_substitutions(DEFAULTS.get(name, ''))
        if LaunchConfiguration(name).perform(context) != perform_substitutions(context, default):
            raise RuntimeError(f'{name}: cannot be used with lanes:={lanes}; see docs/hosts.md')
    line = read_line(Path(lanes))
    kept = kept_running(context)
    environment = [SetEnvironmentVariable(*each) for each in line.environment().items()]
    nodes = [
        Node(
            package='checkweigher_bringup',
            executable='line',
            namespace=share.lane,
            arguments=list(share.nodes),
            parameters=[*map(str, share.params), parameter_file(share.parameters, share.lane)],
            ros_arguments=[*LOG_LEVEL, *enclave_arguments(share.lane, 'line')],
            on_exit=partial(on_exit, respawn=kept['respawn']),
            **kept,
        )
        for share in line.shares(host)
    ]
    return [*environment, *nodes, *make_page(context, kept), *make_gateways(context, kept)]


def parameter_file(parameters, *namespace):
    """Return the path of a temporary file with the parameters of each node."""
    file = NamedTemporaryFile(suffix='.yaml')  # noqa: SIM115
    _files.append(file)
    write_parameter_file(Path(file.name), parameters, *namespace)
    return file.name


def make_page(context, kept):
    """Return the action that starts the page of all lanes if the argument `page` is true."""
    if not is_true(context, 'page'):
        return []
    options = {
        name: kind(value)
        for name, kind in PAGE_OPTIONS.items()
        if (value := LaunchConfiguration(f'page_{name}').perform(context))
    }
    Site(**options).checked()  # raise here, because launch would restart an invalid page forever
    return [
        Node(
            package='checkweigher_web',
            executable='page',
            arguments=[w for name, value in options.items() for w in (f'--{name}', str(value))],
            **kept,
        )
    ]


def make_gateways(context, kept):
    """Return the actions that start the gateways, one for each section of the file `gateways`."""
    file = LaunchConfiguration('gateways').perform(context)
    return [
        Node(
            package='checkweigher_gateways',
            executable='gateway',
            arguments=[kind, '--settings', file],
            **kept,
        )
        for kind in (read_gateways(Path(file)).kinds if file else ())
    ]


def kept_running(context):
    """Return the options of a process that launch restarts unless `respawn` is false.

    On SIGTERM, launch ends without ending its processes, which would then prevent a new start. The
    added environment variable makes each process end with its parent.
    """
    return {
        'output': 'screen',
        'respawn': is_true(context, 'respawn'),
        'respawn_delay': RESPAWN_DELAY,
        'additional_env': child_variable(),
    }


def is_true(context, name):
    """Return whether an argument is true."""
    value = normalize_typed_substitution(LaunchConfiguration(name), bool)
    return perform_typed_substitution(context, value, bool)


def parameter_files(context, params_file, folder, namespace):
    """Return the parameter files of the line. Later files override earlier files."""
    first, files, own = [], [str(params_file)], {}
    if folder:
        machine = MachineFolder.made(Path(folder))
        first, files = [parameter_file(OF_FOLDER)], [*map(str, machine.files(params_file))]
        own = machine.parameters(params_file, restarts=False)
    own['driver'] = own.get('driver', {}) | driver_parameters(context)
    own['reject'] = own.get('reject', {}) | reject_parameters(context)
    return [*first, *files, parameter_file(own, namespace)]


def on_exit(event, context, *, respawn):
    """End the launch if a process of the line cannot start, or ends and `respawn` is false.

    A line without one of its nodes gives no verdicts. The delay before a respawn is long enough to
    end the launch first.
    """
    if event.returncode == CANNOT_START:
        return [Shutdown(reason=f'{event.process_name} cannot start; its message is above')]
    return [] if respawn else [Shutdown(reason='a node of the line has ended')]


def driver_parameters(context):
    """Return the parameters of the driver that are set by arguments."""
    source, bag, rate = (
        LaunchConfiguration(name).perform(context) for name in ('source', 'bag', 'rate')
    )
    parameters = {}
    if source or bag:
        parameters['source'] = source or 'bag'
    if bag:
        parameters['bag.path'] = bag
    if rate:
        try:
            parameters['rate'] = float(rate)
        except ValueError:
            raise RuntimeError(f'rate: {rate!r} is not a number') from None
    return parameters


def reject_parameters(context):
    """Return the parameters of `reject`, which has no deadlines at a rate other than 1."""
    rate = LaunchConfiguration('rate').perform(context)
    return {'deadlines': False} if rate and float(rate) != 1 else {}
