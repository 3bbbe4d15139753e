# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line under the command `run` on the machine of `belt_machine.py`, seen from both ends."""

from collections.abc import Iterator
from contextlib import contextmanager
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from checkweigher_msgs.msg import StopRequest
from graph import call
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from processes import pids_of
from rclpy.node import Node
from running import PATIENCE, free_port, start_command, wait_for
from std_srvs.srv import Trigger

from checkweigher_bringup.spinning import spinning
from checkweigher_core.ros import ports
from checkweigher_driver.line_io.belt_record import OnBelt

MACHINE = Path(__file__).with_name('belt_machine.py')
GOOD, LIGHT, HEAVY = 150.0, 80.0, 240.0  # g
PARAMETERS = """
/**/segmenter:
  ros__parameters:
    {{product_length: 0.1, length_tolerance: 0.04, min_belt_speed: 0.1, numbers: {folder}/items}}
/**/identifier:
  ros__parameters: {{estimator: hann}}
/**/reject:
  ros__parameters:
    {{lower_limit: 0.12, upper_limit: 0.2, rejector_distance: 0.5, verdict_margin: 0.2,
      numbers: {folder}/verdicts}}
/**/driver:
  ros__parameters:
    source: aed
    eyes: modbus
    outputs: modbus
    aed: {{port: {link}, sample_rate: 600.0, counts_per_kg: 5.0e+5, zero_counts: 100000.0,
          capacity: 7.2, weigh_length: 0.2}}
    modbus: {{host: 127.0.0.1, port: {port}, poll_period: 0.005, max_uncertainty: 0.006,
             longest_gap: 0.4}}
    modbus_outputs: {{host: 127.0.0.1, port: {port}, stop: 1, watchdog: 0 {outputs}}}
    rejector: {{pulse: 0.15, late_tolerance: 0.1, watchdog_time: {watchdog} {rejector}}}
"""


class BeltLine:
    """The machine, the line, and what was heard of it."""

    def __init__(
        self,
        folder: Path,
        node: Node,
        *,
        processes: bool,
        wiring: str = 'reject',
        outputs: str = '',
        rejector: str = '',
        watchdog: float = 0.6,
        spacing: float = 0.25,
    ) -> None:
        self.port = free_port()
        self.folder, self.node, self.processes = folder, node, processes
        self.events_file, link = folder / 'events.jsonl', folder / 'cell'
        self.machine = subprocess.Popen(
            [
                *(sys.executable, str(MACHINE), '--port', str(self.port), '--link', str(link)),
                *('--log', str(self.events_file), '--wiring', wiring),
                *('--watchdog', str(watchdog), '--spacing', str(spacing)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.machine.stdout.readline() == 'ready\n'
        text = PARAMETERS.format(
            **{'link': link, 'port': self.port, 'folder': folder},
            **{'outputs': outputs, 'rejector': rejector, 'watchdog': watchdog},
        )
        (folder / 'line.yaml').write_text(text, encoding='utf-8')
        self.log = folder / 'log'
        self.stops: list[Any] = []
        self.verdicts: list[Any] = []
        for topic, heard in ((ports.STOP_REQUEST, self.stops), (ports.VERDICT, self.verdicts)):
            node.create_subscription(topic.type, topic.name, heard.append, topic.qos)
        self._reset = node.create_client(Trigger, '/belt/reset_stop_request')
        self.command: subprocess.Popen[str] | None = None
        self.start()

    def start(self) -> None:
        with self.log.open('a', encoding='utf-8') as file:
            self.command = start_command(
                *('run', '--namespace', 'belt', '--params', self.folder / 'line.yaml'),
                *(['--processes'] if self.processes else []),
                stdout=file,
                stderr=file,
                env={**os.environ, 'XDG_STATE_HOME': str(self.folder / 'state')},
            )

    def tell(self, *words: object) -> Any:
        """Have the machine do something, and return what it answers."""
        print(*words, file=self.machine.stdin, flush=True)
        answer = self.machine.stdout.readline().strip()
        return None if answer == 'done' else json.loads(answer)

    def feed(self, *masses: float) -> None:
        self.tell('feed', *masses)

    def products(self) -> list[list[float]]:
        """Return number, mass, place and state of the products on the belt."""
        found: list[list[float]] = self.tell('products')['products']
        return found

    def events(self) -> list[Any]:
        """Return what the machine has noted: [ns, event, product, mass]."""
        lines = self.events_file.read_text(encoding='utf-8').splitlines()
        return [json.loads(line) for line in lines]

    def recorded(self) -> tuple[str, ...]:
        """Return what is on the belt by the record of the driver."""
        return OnBelt.of_line(self.record.read_bytes()).items

    @property
    def record(self) -> Path:
        (record,) = (self.folder / 'state' / 'checkweigher').glob('*.belt')
        return record

    def runs(self) -> bool:
        states = [entry[1] for entry in self.events() if entry[1] in ('run', 'stop', 'watchdog')]
        return bool(states) and states[-1] == 'run'

    def pids(self, name: str) -> list[int]:
        """Return the processes of a node, or of all that `run` has started for ``line``."""
        return pids_of(self.command.pid, name)

    def signal(self, name: str, number: int) -> int:
        """Send a signal to a node, or in one process to the line; return to which process."""
        (pid,) = self.pids(name if self.processes else 'line')
        os.kill(pid, number)
        return pid

    def change(self, name: str, transition: int) -> bool:
        wanted = Transition(id=transition)
        return bool(
            call(self.node, ChangeState, f'/belt/{name}/change_state', transition=wanted).success
        )

    def reset(self) -> bool:
        """Press the button of the operator; False if nothing comes of it for some seconds."""
        if not self._reset.service_is_ready():
            return False
        answer, end = self._reset.call_async(Trigger.Request()), time.monotonic() + 5.0
        while not answer.done() and time.monotonic() < end:
            time.sleep(0.01)
        return answer.done() and bool(answer.result().success)

    def wait_for(self, condition: Any, what: str, patience: float = PATIENCE) -> None:
        try:
            wait_for(condition, what, patience)
        except AssertionError as error:
            log = self.log.read_text(encoding='utf-8')[-3000:]
            shown = [(s.reason, s.hint) for s in self.stops[-3:]]
            raise AssertionError(f'{error}\n{log}\n{shown}\n{self.products()}') from None

    def stop_text(self) -> str:
        """Return why the line is to stop, empty if it may run."""
        last = self.stops[-1] if self.stops else None
        stopped = last is not None and last.state == StopRequest.STOP
        return f'{last.reason}: {last.hint}' if stopped else ''

    def stop(self) -> None:
        if self.command.poll() is None:
            self.command.send_signal(signal.SIGINT)
            self.command.wait(timeout=60)

    def end(self) -> None:
        self.stop()
        self.machine.stdin.close()
        self.machine.wait(PATIENCE)
        self.machine.stdout.close()


@contextmanager
def belt_line(folder: Path, **options: Any) -> Iterator[BeltLine]:
    """Run a line on a machine for as long as the block lasts."""
    with spinning('belt') as spinner:
        node = Node('operator')
        spinner.add(node)
        line = BeltLine(folder, node, **options)
        try:
            yield line
        finally:
            line.end()
