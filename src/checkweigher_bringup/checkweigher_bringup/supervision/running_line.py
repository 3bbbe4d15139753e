# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Supervisor of a live line, which keeps its processes running and shows its verdicts."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from functools import partial
import os
from pathlib import Path
import queue
import sys
import time
from typing import Any

from checkweigher_bringup.commissioning.machine_folder import DEFAULTS, MachineFolder
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.hosts.description import LineDescription
from checkweigher_bringup.listening import EchoNode
from checkweigher_bringup.output import ItemTable
from checkweigher_bringup.spinning import (
    asked_to_end,
    memory_file,
    node_command,
    spinning,
    write_parameter_file,
)
from checkweigher_bringup.supervision.processes import SupervisedProcess, say
from checkweigher_bringup.supervision.service_manager import Watchdog, supervises
from checkweigher_core.parent_process import CANNOT_START
from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.place import Place
from checkweigher_core.ros.graph.policy import RUN
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.services import GATEWAYS
from checkweigher_gateways.settings import read_gateways

Command = Callable[[], Sequence[str]]  # function that returns the words of a command

_POLL_PERIOD = 0.1  # s
_DISCOVERY_TIME = 1.0  # time in s to wait for the discovery of a driver that already runs
_MODULE = 'checkweigher_bringup.line'
# Nodes that run beside the line, and that the line does not need.
BESIDE = {
    'dynamic_setting': 'checkweigher_bringup.commissioning.dynamic_setting',
    'verifier': 'checkweigher_bringup.commissioning.verifier',
    'batch_reporter': 'checkweigher_bringup.batch_reporter',
}
_PAGE = 'page'
_PAGE_COMMAND = (sys.executable, '-m', 'checkweigher_bringup.cli', 'page')
_GATEWAY_COMMAND = (sys.executable, '-m', 'checkweigher_gateways.gateway')
_SILENT = ('batch_reporter', _PAGE)  # processes that publish no diagnostics
_NOT_NEEDED = {*BESIDE, _PAGE, *GATEWAYS}


def run_line(
    params: Path | None,
    namespace: str,
    driver: Mapping[str, object],
    *,
    apart: bool,
    page: Sequence[str] | None = None,
    folder: MachineFolder | None = None,
    gateways: Path | None = None,
) -> int:
    """Run the line until SIGINT, SIGTERM or SIGHUP, and return the exit status of the command.

    The status is 128 plus the number of the signal, or `CANNOT_START` if a process of the line
    cannot start or, under systemd, has ended. `params` is the parameter file of the user, or None.
    The parameters `driver` override the file `params`. With `apart`, each node has its own process.
    `page` contains the options of the page, or is None if the page is not served. With a `folder`,
    the line keeps the state of the machine in this folder, and the nodes of `BESIDE` run as well.
    The gateways of the file `gateways` run beside the line. Raises `UserError` or `ParameterError`
    if a line already runs in this lane, and `SettingsError` if the file `gateways` is invalid.
    """
    with asked_to_end() as asked, memory_file() as first, memory_file() as last:
        files = _parameter_files(first, params, last, namespace, driver, folder)
        modules = {**(ports.NODES if apart else {'line': _MODULE}), **(BESIDE if folder else {})}
        commands: dict[str, Command] = {
            name: partial(_with_files, module, namespace, files) for name, module in modules.items()
        }
        commands |= _page_commands(page, namespace, folder)
        commands |= _gateway_commands(gateways, namespace)
        processes = _processes(commands)
        with spinning(namespace, RUN) as spinner, closing(ItemTable()) as table:
            node = EchoNode(RUN)
            lane = node.get_namespace().rstrip('/')
            names = (*ports.NODES, *processes)
            whole = processes.get('line')
            process_of = {f'{lane}/{name}': processes.get(name, whole) for name in names}
            watchdog = _listen(node, process_of)
            # If two lines start at the same time, the second one raises `ParameterError` here.
            place = Place(node.context.get_domain_id(), node.resolve_topic_name('line'))
            spinner.add(node)
            time.sleep(_DISCOVERY_TIME)
            if node.count_drivers():
                raise UserError(
                    'a line runs here already; stop it, or choose another --namespace or '
                    'ROS_DOMAIN_ID'
                )

            def meanwhile() -> None:
                if folder is not None and folder.take_restart():
                    _restart(processes)
                    watchdog.restarted(time.monotonic())
                with suppress(queue.Empty):
                    table.show(node.result(node.weighings.get(timeout=_POLL_PERIOD)))

            try:
                return _supervise(processes, watchdog, asked, meanwhile)
            finally:
                place.free()


def run_host(line: LineDescription, host: str) -> int:
    """Run the nodes of a host until SIGINT, SIGTERM or SIGHUP, and return the exit status.

    The status is 128 plus the number of the signal, or `CANNOT_START` if a process cannot start or,
    under systemd, has ended. Raises `SettingsError` if the host is unknown.
    """
    shares = line.shares(host)
    os.environ.update(line.environment())
    with ExitStack() as stack, asked_to_end() as asked, spinning(enclave=RUN) as spinner:
        processes: dict[str, SupervisedProcess] = {}
        process_of: dict[str, SupervisedProcess] = {}
        for share in shares:
            file = stack.enter_context(memory_file())
            write_parameter_file(file, share.parameters, share.lane)
            command = node_command(_MODULE, share.lane, *share.params, file, nodes=share.nodes)
            process = SupervisedProcess(share.name, partial(list, command), kept=not supervises())
            processes[share.name] = process
            process_of |= {f'/{share.lane}/{name}': process for name in share.nodes}
        print(f'{host}: {", ".join(processes) or "nothing to run"}', file=sys.stderr, flush=True)
        node = PortNode(RUN)
        watchdog = _listen(node, process_of)
        spinner.add(node)
        return _supervise(processes, watchdog, asked, partial(time.sleep, _POLL_PERIOD))


def _listen(node: PortNode, process_of: Mapping[str, SupervisedProcess | None]) -> Watchdog:
    """Subscribe to the diagnostics, and pass them on to the processes and to the watchdog.

    `process_of` maps the full name of each node to its process, or to None if this program does not
    run the node. Returns the watchdog of the nodes of the line.
    """
    watchdog = Watchdog(name for name in process_of if name.rpartition('/')[2] in ports.NODES)

    def on_diagnostics(message: Any) -> None:
        for status in message.status:
            name = '/' + status.name.partition(':')[0].strip('/')
            watchdog.heard(name, time.monotonic())
            if (process := process_of.get(name)) is not None:
                process.heard(time.monotonic())

    node.subscribe(ports.DIAGNOSTICS, on_diagnostics)
    return watchdog


def _parameter_files(
    first: Path,
    params: Path | None,
    last: Path,
    namespace: str,
    driver: Mapping[str, object],
    folder: MachineFolder | None,
) -> Callable[[], list[Path]]:
    """Return a function that returns the parameter files for the next start of the line.

    The files are in ascending order of precedence. The file `last` contains the parameters `driver`
    and, with a `folder`, those that make the nodes use the folder. With a `folder`, the file
    `first` contains defaults, which the file of the user and the trained parameters override.
    """
    if folder is None:
        given = [] if params is None else [params]
        if driver:
            write_parameter_file(last, {'driver': driver}, namespace)
            given.append(last)
        return lambda: given
    own = folder.parameters(params, restarts=True)
    write_parameter_file(first, DEFAULTS)
    write_parameter_file(last, {**own, 'driver': {**own['driver'], **driver}}, namespace)
    return lambda: [first, *folder.files(params), last]


def _processes(commands: Mapping[str, Command]) -> dict[str, SupervisedProcess]:
    """Return a supervised process for each command by name. The processes are not started yet."""
    return {
        name: SupervisedProcess(
            name, command, reports=name not in _SILENT, kept=name in _NOT_NEEDED or not supervises()
        )
        for name, command in commands.items()
    }


def _page_commands(
    options: Sequence[str] | None, namespace: str, folder: MachineFolder | None
) -> dict[str, Command]:
    if options is None:
        return {}
    kept = [] if folder is None else ['--keep', str(folder.path / 'kept')]
    return {_PAGE: partial(list, [*_PAGE_COMMAND, *options, '--namespace', namespace, *kept])}


def _gateway_commands(file: Path | None, namespace: str) -> dict[str, Command]:
    """Return a command for each section of a gateway settings file, or none without a file."""
    lane = ['--settings', str(file), '--namespace', namespace]
    kinds = [] if file is None else read_gateways(file).kinds
    return {f'gateway_{kind}': partial(list, [*_GATEWAY_COMMAND, kind, *lane]) for kind in kinds}


def _with_files(module: str, namespace: str, files: Callable[[], list[Path]]) -> list[str]:
    """Return the command that runs a module with the parameter files that `files` returns now.

    The trained parameters may be created or replaced while the line runs, so the command must be
    made at each start of the process.
    """
    return node_command(module, namespace, *files())


def _supervise(
    processes: Mapping[str, SupervisedProcess],
    watchdog: Watchdog,
    asked: Sequence[int],
    meanwhile: Callable[[], None],
) -> int:
    """Keep processes running, and call `meanwhile` repeatedly, until a signal arrives.

    The function also returns if a process of the line cannot start or, under systemd, has ended.
    Before the function returns, it ends all processes. Returns the exit status of the command: 128
    plus the number of the first signal, or `CANNOT_START` if no signal has arrived.
    """
    try:
        while not asked:
            now = time.monotonic()
            # Each process is checked, even if another one has failed.
            failed = {name for name, process in processes.items() if not process.look(now)}
            if failed - _NOT_NEEDED:
                return CANNOT_START
            watchdog.feed(now)
            meanwhile()
        return 128 + asked[0]
    finally:
        _end(processes)


def _restart(processes: Mapping[str, SupervisedProcess]) -> None:
    """Restart the processes of the line, while the other processes continue."""
    line = {name: process for name, process in processes.items() if name not in _NOT_NEEDED}
    say('the line is restarted on request')
    _end(line)
    for process in line.values():
        process.renew()


def _end(processes: Mapping[str, SupervisedProcess]) -> None:
    """End the processes of the line, and then all other processes.

    The first process of the line ends first, and its last process ends last. If each node has its
    own process, the driver ends first and `reject` ends last, so that items on the belt still get
    their verdicts.
    """
    line = [process for name, process in processes.items() if name not in _NOT_NEEDED]
    beside = [process for name, process in processes.items() if name in _NOT_NEEDED]
    for group in (line[:1], line[1:-1], line[-1:], beside):
        for process in group:
            process.terminate()
        for process in group:
            process.wait()
