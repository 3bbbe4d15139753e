# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A live line under supervision: its processes are kept running, and its verdicts are shown."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
import queue
import sys
import time
from typing import Any

from checkweigher_bringup.commissioning.machine_folder import MachineFolder
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.listening import EchoNode
from checkweigher_bringup.output import Table
from checkweigher_bringup.spinning import (
    Process,
    asked_to_end,
    end_process,
    memory_file,
    node_command,
    spinning,
    start_process,
    write_parameter_file,
)
from checkweigher_bringup.supervision import CANNOT_START, Action, Supervision
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.graph.place import Place
from checkweigher_web.access.users import default_users

_POLL_PERIOD = 0.1  # s
_DISCOVERY_TIME = 1.0  # s, in which a driver that is there already shows up
LINE = {'line': 'checkweigher_bringup.line'}
# Beside the line of a machine, which does not depend on them.
BESIDE = {
    'dynamic_setting': 'checkweigher_bringup.commissioning.dynamic_setting',
    'verifier': 'checkweigher_bringup.commissioning.verifier',
    'batch_reporter': 'checkweigher_bringup.batch_reporter',
}
_SILENT = ('batch_reporter',)  # without diagnostics


class SupervisedProcess:
    """One process of the line under supervision; without `reports` it sends no diagnostics."""

    def __init__(
        self, name: str, command: Callable[[], Sequence[str]], *, reports: bool = True
    ) -> None:
        self._name = name
        self._command = command
        self._reports = reports
        self._supervision = Supervision(reports=reports)
        self._child: Process | None = None

    def heard(self, now: float) -> None:
        """Note that diagnostics of it came."""
        self._supervision.heard(now)

    def look(self, now: float) -> bool:
        """Start or kill the process if that is due; return whether the line can go on."""
        if self._child is not None and (status := self._child.poll()) is not None:
            self._child = None
            self._supervision.ended(now, status)
        action = self._supervision.due(now)
        if action is Action.START:
            self._child = start_process(self._command())
            away = self._supervision.started(now)
            if self._supervision.reason:
                _say(f'{self._name}: {self._supervision.reason}; started again after {away:.1f} s')
        elif action is Action.KILL and self._child is not None:
            self._child.kill()
        return action is not Action.GIVE_UP

    def terminate(self) -> None:
        """Ask the process to end."""
        if self._child is not None:
            self._child.terminate()

    def wait(self) -> None:
        """Wait until the process has ended, and kill it if it does not."""
        if self._child is not None and not end_process(self._child):
            _say(f'{self._name}: did not end; killed')

    def renew(self) -> None:
        """Have a process that was ended on purpose start again at once."""
        self._child, self._supervision = None, Supervision(reports=self._reports)


class _Listener(EchoNode):
    """Listen to the results of the lane, and to which of its nodes are `alive`."""

    def __init__(self) -> None:
        super().__init__()
        self.alive: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.listen(ports.DIAGNOSTICS, self._on_diagnostics)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            namespace, _, name = status.name.lstrip('/').rpartition('/')
            if namespace == self.get_namespace().strip('/'):
                self.alive.put(name.split(':')[0])


def run_line(
    params: Path | None, namespace: str, driver: Mapping[str, object], *, one_process: bool,
    page: int | None = None, folder: MachineFolder | None = None,
) -> int:  # fmt: skip
    """Run the line until a signal asks for its end, and return the exit status.

    The parameters of the `driver` win over the file `params`; `page` is the port of the page, None
    for none. With a `folder` the line keeps there what becomes of its machine, and the nodes of
    `BESIDE` run beside it. A UserError says that there is a line already in this lane.
    """
    with asked_to_end() as asked, memory_file() as first, memory_file() as last:
        files = _parameter_files(first, params, last, driver, folder)
        modules = {**(LINE if one_process else ports.NODES), **(BESIDE if folder else {})}
        processes = {
            name: SupervisedProcess(
                name, partial(_command, module, namespace, files), reports=name not in _SILENT
            )
            for name, module in modules.items()
        }
        with spinning(namespace) as spinner:
            node = _Listener()
            # Held to the end, so that of two that start at once one goes on.
            place = Place(node.context.get_domain_id(), node.resolve_topic_name('line'))
            spinner.add(node)
            time.sleep(_DISCOVERY_TIME)
            if node.count_drivers():
                raise UserError('a line runs here already; stop it, or choose another '
                                '--namespace or ROS_DOMAIN_ID')  # fmt: skip
            with _page_beside(page, namespace, folder):  # that ends after the line
                try:
                    return _supervise(processes, node, asked, folder)
                finally:
                    _end(processes)
                    place.free()


def _parameter_files(
    first: Path, params: Path | None, last: Path, driver: Mapping[str, object],
    folder: MachineFolder | None,
) -> Callable[[], list[Path]]:  # fmt: skip
    """Return what gives the parameter files of the line as they are when it starts.

    Those of the user stand between `first`, which they overrule, and `last`, which overrules them.
    """
    if folder is None:
        given = [] if params is None else [params]
        if driver:
            write_parameter_file(last, {'driver': driver})
            given.append(last)
        return lambda: given
    own = folder.parameters(params, restarts=True)
    write_parameter_file(first, folder.defaults())
    write_parameter_file(last, {**own, 'driver': {**own['driver'], **driver}})
    return lambda: [first, *folder.files(params), last]


def _command(module: str, namespace: str, files: Callable[[], list[Path]]) -> list[str]:
    return node_command(module, namespace, *files())


@contextmanager
def _page_beside(
    port: int | None, namespace: str, folder: MachineFolder | None
) -> Iterator[None]:  # fmt: skip
    """Serve the page while the block lasts, in a process that the line does not depend on.

    The page itself says its address, or why it cannot be served.
    """
    if port is None:
        yield
        return
    command = [sys.executable, '-m', 'checkweigher_bringup.cli', 'page', '--port', str(port)]
    keep = ['--keep', str(folder.kept)] if folder is not None and default_users().exists() else []
    process = start_process([*command, '--namespace', namespace, *keep])
    try:
        yield
    finally:
        process.terminate()
        end_process(process)


def _supervise(
    processes: Mapping[str, SupervisedProcess], node: _Listener, asked: Sequence[int],
    folder: MachineFolder | None,
) -> int:  # fmt: skip
    table = Table()
    try:
        while not asked:
            now = time.monotonic()
            while not node.alive.empty():
                name = node.alive.get()
                # In one process any node speaks for all: they share one executor.
                speaks_for = (name,) if name in BESIDE else (name, 'line')
                for process in [processes[n] for n in speaks_for if n in processes]:
                    process.heard(now)
            if folder is not None and folder.take_restart():
                _restart(processes)
            # All of them: the first to fail must not keep the others from being looked after.
            going = {name: process.look(now) for name, process in processes.items()}
            if not all(well for name, well in going.items() if name not in BESIDE):
                return CANNOT_START
            with suppress(queue.Empty):
                table.show(node.result(node.weighings.get(timeout=_POLL_PERIOD)))
        return 128 + asked[0]
    finally:
        table.close()


def _restart(processes: Mapping[str, SupervisedProcess]) -> None:
    """End the line and have it start again; the nodes beside it go on."""
    line = {name: process for name, process in processes.items() if name not in BESIDE}
    _say('the line starts again, as was asked')
    _end(line)
    for process in line.values():
        process.renew()


def _end(processes: Mapping[str, SupervisedProcess]) -> None:
    """End all processes, the driver first, reject last of the line; no signal hurries it."""
    names = [name for name in processes if name not in BESIDE]
    beside = [name for name in processes if name in BESIDE]
    for group in (names[:1], names[1:-1], names[-1:], beside):
        for name in group:
            processes[name].terminate()
        for name in group:
            processes[name].wait()


def _say(text: str) -> None:
    with suppress(OSError):  # the terminal may be gone, the processes of the line are not
        print(f'{time.strftime("%H:%M:%S")} {text}', file=sys.stderr, flush=True)
