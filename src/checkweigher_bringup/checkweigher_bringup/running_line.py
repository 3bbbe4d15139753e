"""What `run` does: keep the processes of a live line running and show what comes out of it."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
import queue
import signal
import subprocess
import sys
import tempfile
import time
from types import FrameType
from typing import Any

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.listening import EchoNode
from checkweigher_bringup.output import Table
from checkweigher_bringup.replaying import write_parameter_file
from checkweigher_bringup.spinning import ros_arguments, spinning
from checkweigher_bringup.supervision import CANNOT_START, Action, Patience, Supervision
from checkweigher_dsp.ros import ports

_POLL_PERIOD = 0.1  # s
_DISCOVERY_TIME = 1.0  # s, in which a driver that is there already shows up
_END_PATIENCE = 5.0  # s, for a process to end by itself
LINE = {'line': 'checkweigher_bringup.line'}


@dataclass(frozen=True)
class Run:
    """What line to run and how.

    Attributes
    ----------
    params : Path or None
        ROS parameter file.
    namespace : str
        Of the lane.
    processes : bool
        Whether each node has a process of its own.
    overrides : mapping
        Parameters that win over the file, for each node.
    patience : Patience
        Of the supervision.
    """

    params: Path | None = None
    namespace: str = ''
    processes: bool = False
    overrides: Mapping[str, dict[str, object]] = field(default_factory=dict)
    patience: Patience = field(default_factory=Patience)

    @property
    def modules(self) -> dict[str, str]:
        """Name and module of each process."""
        return ports.NODES if self.processes else LINE


class _Process:
    """One process of the line under supervision."""

    def __init__(self, name: str, command: Sequence[str], patience: Patience) -> None:
        self.name = name
        self._command = command
        self._supervision = Supervision(patience)
        self._child: subprocess.Popen[bytes] | None = None

    def heard(self, now: float) -> None:
        self._supervision.heard(now)

    def look(self, now: float) -> bool:
        """Do what has to be done; return whether the line can go on."""
        if self._child is not None and (status := self._child.poll()) is not None:
            self._child = None
            self._supervision.ended(now, status)
        action = self._supervision.due(now)
        if action is Action.START:
            # Signals of the terminal reach this command alone, which ends the others in order.
            self._child = subprocess.Popen(self._command, process_group=0)
            away = self._supervision.started(now)
            if self._supervision.reason:
                _say(f'{self.name}: {self._supervision.reason}; started again after {away:.1f} s')
        elif action is Action.KILL and self._child is not None:
            self._child.kill()
        return action is not Action.GIVE_UP

    def interrupt(self) -> None:
        if self._child is not None:
            self._child.send_signal(signal.SIGINT)

    def wait(self) -> None:
        if self._child is None:
            return
        try:
            self._child.wait(timeout=_END_PATIENCE)
        except subprocess.TimeoutExpired:
            _say(f'{self.name}: does not end; killed')
            self._child.kill()
            self._child.wait()


class _Listener(EchoNode):
    """Listens to results and to the diagnostics of the lane."""

    def __init__(self, alive: Callable[[str], None]) -> None:
        super().__init__()
        self._prefix = self.get_namespace().strip('/')
        self._alive = alive
        self.listen(ports.DIAGNOSTICS, self._on_diagnostics)

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            namespace, _, name = status.name.lstrip('/').rpartition('/')
            if namespace == self._prefix:
                self._alive(name.split(':')[0])

    def has_driver(self) -> bool:
        """Tell whether somebody publishes samples in this lane."""
        return self.count_publishers(self.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name)) > 0


def run_line(plan: Run) -> int:
    """Run the line until SIGINT or SIGTERM and return the exit status.

    Raises
    ------
    UserError
        If there is a line already in this lane.
    """

    def end(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, end)
    with tempfile.TemporaryDirectory(prefix='checkweigher-') as folder:
        processes = _processes(plan, Path(folder, 'overrides.yaml'))
        try:
            with spinning(plan.namespace) as spinner:
                heard: queue.SimpleQueue[str] = queue.SimpleQueue()
                node = _Listener(heard.put)
                spinner.add(node)
                time.sleep(_DISCOVERY_TIME)
                if node.has_driver():
                    raise UserError(
                        'a line runs here already; stop it, or choose another --namespace or '
                        'ROS_DOMAIN_ID'
                    )
                try:
                    return _supervise(processes, node, heard)
                finally:
                    _end(processes)
        except KeyboardInterrupt:
            return 130


def _processes(plan: Run, overrides: Path) -> dict[str, _Process]:
    arguments = ['--ros-args']
    if plan.params is not None:
        arguments += ['--params-file', str(plan.params)]
    if plan.overrides:
        write_parameter_file(overrides, dict(plan.overrides))
        arguments += ['--params-file', str(overrides)]
    return {
        name: _Process(
            name,
            [sys.executable, '-m', module, *arguments, *ros_arguments(plan.namespace)],
            plan.patience,
        )
        for name, module in plan.modules.items()
    }


def _supervise(
    processes: Mapping[str, _Process], node: _Listener, heard: 'queue.SimpleQueue[str]'
) -> int:
    table = Table()
    try:
        while True:
            now = time.monotonic()
            while not heard.empty():
                name = heard.get()
                # In one process any node speaks for all: they share one executor.
                for process in [processes[n] for n in (name, 'line') if n in processes]:
                    process.heard(now)
            # All of them: the first to fail must not keep the others from being looked after.
            if not all([process.look(now) for process in processes.values()]):
                return CANNOT_START
            with suppress(queue.Empty):
                table.show(node.result(node.weighings.get(timeout=_POLL_PERIOD)))
    finally:
        table.close()


def _end(processes: Mapping[str, _Process]) -> None:
    """End all processes, the driver first and reject last; further signals do not hurry it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    names = list(processes)
    for group in (names[:1], names[1:-1], names[-1:]):
        for name in group:
            processes[name].interrupt()
        for name in group:
            processes[name].wait()


def _say(text: str) -> None:
    print(f'{time.strftime("%H:%M:%S")} {text}', file=sys.stderr, flush=True)
