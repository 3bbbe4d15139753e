# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a live line and keep it running."""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import add_namespace, add_parameter_file
from checkweigher_web import PORT


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `run`."""
    add_parameter_file(parser)
    add_namespace(parser)
    add = parser.add_argument
    add('--processes', action='store_true',
        help='run each node in a process of its own; each is started again when it dies or hangs',
    )  # fmt: skip
    add('--source', metavar='NAME',
        help='where samples and edges come from; default: as in FILE, else the simulator',
    )  # fmt: skip
    add('--bag', type=Path, metavar='BAG', help='bag to play; means --source bag')
    add(
        '--line',
        type=Path,
        metavar='FILE',
        help='description of a line over several hosts (YAML); runs the share of one',
    )
    add('--host', metavar='NAME', help='the host of FILE whose share is run')
    add('--folder', type=Path, metavar='DIR',
        help='folder of this machine: calibration, trained parameters, recipes, audit log; made '
        'if there is none. The dynamic setting runs beside the line, and a simulated line has no '
        'end')  # fmt: skip
    add('--page', action='store_true', help='serve the page of the line as well, see page --help')
    add('--page-port', type=int, metavar='N', help=f'port of the page; default {PORT}')


def run(arguments: argparse.Namespace) -> int:
    """Run the line until interrupted; 2 if it cannot start."""
    if arguments.line is not None or arguments.host is not None:
        return _run_host(arguments)
    from checkweigher_bringup.commissioning.machine_folder import MachineFolder
    from checkweigher_bringup.running_line import run_line
    from checkweigher_bringup.settings import check_namespace, line_parameters
    from checkweigher_driver.devices import DriverParameters

    namespace = check_namespace(arguments.namespace)
    # Raises ParameterError before anything is started.
    line_parameters(arguments.params, None, namespace or None)
    driver: dict[str, object] = {}
    if arguments.source or arguments.bag:
        driver['source'] = DriverParameters(source=arguments.source or 'bag').source
    if arguments.bag:
        driver['bag.path'] = str(arguments.bag.absolute())
    page = None
    if arguments.page or arguments.page_port is not None:
        page = PORT if arguments.page_port is None else arguments.page_port
    folder = None if arguments.folder is None else MachineFolder.made(arguments.folder)
    return run_line(
        arguments.params, namespace, driver, one_process=not arguments.processes, page=page,
        folder=folder,
    )  # fmt: skip


def _run_host(arguments: argparse.Namespace) -> int:
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.hosts.description import read_line
    from checkweigher_bringup.running_line import run_host

    if arguments.line is None or arguments.host is None:
        raise UserError('--line and --host belong together: the file, and a host of it')
    for name in (
        'params',
        'namespace',
        'processes',
        'source',
        'bag',
        'folder',
        'page',
        'page_port',
    ):
        if getattr(arguments, name):
            option = name.replace('_', '-')
            raise UserError(f'--{option}: the line description says that; see docs/hosts.md')
    return run_host(read_line(arguments.line), arguments.host)
