# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Run a live line, show each verdict, and restart processes that end.

Examples
--------
checkweigher run --params my_line.yaml --processes
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NAMESPACE, PARAMS, TLS
from checkweigher_web import ADDRESS, PORT

OPTIONS = (
    PARAMS,
    NAMESPACE,
    ('--processes', bool, 'run each node in a process of its own'),
    (
        '--source NAME',
        str,
        'source of samples and edges; default: that of the parameter file, or simulator',
    ),
    ('--bag BAG', Path, 'bag to play; this option implies --source bag'),
    ('--line FILE', Path, 'description of a line on several hosts (YAML); needs --host'),
    ('--host NAME', str, 'name of this host in the description of the line'),
    (
        '--folder DIR',
        Path,
        'folder of this machine with calibration, trained parameters, recipes and audit log, '
        'which is created if necessary; dynamic setting, verification and batch reports then also '
        'run, and a simulated line has no end',
    ),
    ('--page', bool, 'also serve the page of the line, see page --help'),
    ('--page-port N', int, f'port of the page; default {PORT}'),
    (
        '--page-host ADDRESS',
        str,
        f'address of the page, by default {ADDRESS}; any other one needs TLS',
    ),
    *TLS,
    (
        '--gateways FILE',
        Path,
        'settings file of the gateways (YAML); also run a gateway for each of its sections',
    ),
)


def run(arguments: argparse.Namespace) -> int:
    """Run the line until a signal arrives, and return 128 plus the number of the signal.

    Returns 2 if the line cannot start.
    """
    if arguments.line is not None or arguments.host is not None:
        return _run_host(arguments)
    from checkweigher_bringup.commissioning.machine_folder import MachineFolder
    from checkweigher_bringup.settings import check_namespace, line_parameters
    from checkweigher_bringup.supervision.running_line import run_line
    from checkweigher_driver.devices import DriverParameters

    namespace = check_namespace(arguments.namespace)
    # An invalid parameter file raises ParameterError here, before a process starts.
    line_parameters(arguments.params, lane=namespace or None)
    driver: dict[str, object] = {}
    if arguments.bag:
        driver = {'source': 'bag', 'bag.path': str(arguments.bag.absolute())}
    if arguments.source:
        driver['source'] = DriverParameters(source=arguments.source).source
    folder = arguments.folder and MachineFolder.made(arguments.folder)
    apart = arguments.processes
    return run_line(
        arguments.params,
        namespace,
        driver,
        apart=apart,
        page=_page_options(arguments),
        folder=folder,
        gateways=arguments.gateways,
    )


def _page_options(arguments: argparse.Namespace) -> list[str] | None:
    """Return the options for the command `page`, or None if the page is not served.

    The page is served if `--page` or one of the options of the page was given.

    Raises `PageError` or `CertificateError` if the page cannot be served.
    """
    from checkweigher_web.access.site import Site

    options = {
        'port': arguments.page_port,
        'host': arguments.page_host,
        'certificate': arguments.certificate,
        'key': arguments.key,
    }
    given = {name: value for name, value in options.items() if value is not None}
    if not (given or arguments.page):
        return None
    Site(**given).checked()
    return [word for name, value in given.items() for word in (f'--{name}', str(value))]


def _run_host(arguments: argparse.Namespace) -> int:
    from checkweigher_bringup.errors import UserError
    from checkweigher_bringup.hosts.description import read_line
    from checkweigher_bringup.supervision.running_line import run_host

    if arguments.line is None or arguments.host is None:
        raise UserError('--line and --host must be given together: a file, and a host in it')
    for name in sorted(vars(arguments).keys() - {'command', 'run', 'line', 'host'}):
        if getattr(arguments, name):
            option = name.replace('_', '-')
            raise UserError(f'--{option}: cannot be used with --line; see docs/hosts.md')
    return run_host(read_line(arguments.line), arguments.host)
