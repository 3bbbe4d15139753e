# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast the graph is: latency, cost, replay and start-up, each beside a reference.

    source setup/environment && python bench/graph.py [--quick] [--only latency] [--json FILE]

The reference of a latency is one raw hop over DDS between two processes, measured in the same run;
that of a replay and of `weigh` is reading the bag, that of windows on all cores is one core. The
simulated line has 4.3 products a second at 90 m/min.
"""

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
import os
from pathlib import Path
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from typing import Any

from batch import COMMAND, batch_figures, run
from builtin_interfaces.msg import Time
from figures import Figure, figure, table, write_json
from processes import HERE, Listener, Process, Usage, line_commands, listener, started

from checkweigher_core.records import Decision, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_record
from checkweigher_core.ros.ports import Port
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters

_SPEED, _SPACING = 1.5, 0.35  # m/s, m
_SETTLED = 10  # items, or messages, until all have found each other and are warm
_PATIENCE = 60.0  # s without a verdict
_HOP_THERE = 0.09  # ms, a raw hop on the machine for which the targets of latency were set


def parameters(bag: Path) -> dict[str, dict[str, object]]:
    """Return the parameters of a line that plays a bag at true time."""
    return {'driver': {'source': 'bag', 'bag.path': str(bag)}}


@dataclass(frozen=True, slots=True)
class Trial:
    """Lanes that run at true time.

    Attributes
    ----------
    items : int
        Of each lane.
    lanes : int
        At once.
    one_process : bool
        Whether the nodes of a lane share a process.
    spacing : float
        m, of the items at 90 m/min.
    """

    items: int
    lanes: int = 1
    one_process: bool = True
    spacing: float = _SPACING

    @property
    def name(self) -> str:
        """What it is, in a table."""
        name = 'one process' if self.one_process else 'a process per node'
        if self.lanes > 1:
            name += f', {self.lanes} lanes'
        if self.spacing != _SPACING:
            name += f', {_SPEED / self.spacing:.1f} items a second'
        return name

    @property
    def duration(self) -> float:
        """How long the items take, s."""
        return self.items * self.spacing / _SPEED


def write_line(bag: Path, count: int, spacing: float) -> None:
    """Write a bag of the simulated line: to make its noise is not what a line has to do."""
    values: dict[str, object] = {'count': count, 'speed': _SPEED, 'spacing': spacing}
    simulation = Simulation(SimulationParameters.from_mapping(values))
    write_bag(bag, simulation.load_cell, simulation)


def measure_hop(count: int) -> Figure:
    """Return the time of a raw hop between two processes, ms: half of there and back."""
    with listener() as here, started([[HERE / 'echoing.py', '--ros-args']]):
        came: list[int] = []
        there = here.node.create_publisher(Time, 'there', 1000)
        back = lambda _: came.append(time.monotonic_ns())  # noqa: E731
        subscription = here.node.create_subscription(Time, 'back', back, 1000)
        here.spin_until(
            lambda: there.get_subscription_count() > 0 and subscription.get_publisher_count() > 0,
            _PATIENCE,
        )
        values = []
        for number in range(_SETTLED + count):
            time.sleep(0.005)  # as a line has it: nobody is warm from the message before
            sent = time.monotonic_ns()
            there.publish(Time(sec=number))
            here.spin_until(lambda number=number: len(came) > number, _PATIENCE)  # type: ignore[misc]
            values.append((came[-1] - sent) / 2e6)
    return figure('raw hop between two processes', 'ms', values[_SETTLED:])


@dataclass
class Arrivals:
    """Verdicts of a lane and when they came, ns of the monotonic clock."""

    verdicts: list[tuple[int, Verdict]]

    def listen(self, here: Listener, namespace: str = '') -> None:
        """Subscribe to the verdicts of a lane."""
        topic: Port = ports.VERDICT
        name = f'/{namespace}/{topic.name}' if namespace else topic.name
        # Those from before this process was found as well.
        here.node.create_subscription(topic.type, name, self._take, topic.qos)

    def _take(self, message: Any) -> None:
        self.verdicts.append((time.monotonic_ns(), to_record(ports.VERDICT, message)))

    def delays(self, stamps: Path) -> list[float]:
        """Return how long each verdict took from the edge t3 at the driver, ms."""
        pairs = (line.split() for line in stamps.read_text(encoding='ascii').splitlines())
        there = {int(stamp): int(when) for stamp, when in pairs}
        return [
            (came - there[verdict.t3]) / 1e6
            for came, verdict in self.verdicts[_SETTLED:]
            if verdict.t3 in there
        ]

    @property
    def spoilt(self) -> int:
        """How many verdicts were late or faults."""
        return sum(
            verdict.late or verdict.decision is Decision.FAULT for _, verdict in self.verdicts
        )


@contextmanager
def running(
    trial: Trial,
) -> Iterator[tuple[Listener, list[Arrivals], list[list[Process]], list[Path]]]:
    """Have the lanes of a trial."""
    lanes = trial.lanes
    with tempfile.TemporaryDirectory() as folder, listener() as here:
        arrivals = [Arrivals([]) for _ in range(lanes)]
        stamps = [Path(folder, f'stamps{lane}') for lane in range(lanes)]
        commands = []
        bag = Path(folder, 'bag')
        write_line(bag, trial.items, trial.spacing)
        for lane in range(lanes):
            arrivals[lane].listen(here, f'lane{lane}')
            file = Path(folder, f'lane{lane}.yaml')
            commands += line_commands(
                file,
                parameters(bag),
                stamps[lane],
                one_process=trial.one_process,
                namespace=f'lane{lane}',
            )
        with started(commands) as processes:
            size = len(processes) // lanes
            grouped = [processes[lane * size : (lane + 1) * size] for lane in range(lanes)]
            yield here, arrivals, grouped, stamps


def measure_line(trial: Trial, hop: Figure) -> list[Figure]:
    """Return latency, cost and memory of lanes that run at true time."""
    count, what = trial.items, trial.name
    with running(trial) as (here, arrivals, grouped, stamps):
        usages = []
        for wanted in (_SETTLED, count):
            with suppress(TimeoutError):  # a machine that is too slow for so many lanes
                here.spin_until(
                    lambda: all(len(a.verdicts) >= wanted for a in arrivals),  # noqa: B023
                    _PATIENCE + trial.duration,
                )
            usages.append([[each.usage() for each in processes] for processes in grouped])
        for process in (each for processes in grouped for each in processes):
            process.end()
        delays = [
            delay for a, file in zip(arrivals, stamps, strict=True) for delay in a.delays(file)
        ]
        missing = sum(max(count - len(a.verdicts), 0) for a in arrivals)
        spoilt = sum(a.spoilt for a in arrivals)
    begin, end = usages
    shares = [_share(*each) for each in zip(begin, end, strict=True)]
    resident = [sum(usage.resident for usage in lane) / 1000 for lane in end]
    growth = [
        sum(b.resident - a.resident for a, b in zip(*each, strict=True)) / 1000
        for each in zip(begin, end, strict=True)
    ]
    return [
        *_latencies(what, delays, hop, one_process=trial.one_process),
        figure(f'processor, {what}', '% of a core', shares, target=4.0),
        figure(f'memory, {what}', 'MB', resident),
        figure(f'its growth, {what}', 'MB', growth),
        figure(f'late verdicts and faults, {what}', '', [float(spoilt)], target=0.0),
        figure(f'verdicts missing, {what}', '', [float(missing)], target=0.0),
    ]


def _latencies(what: str, delays: list[float], hop: Figure, *, one_process: bool) -> list[Figure]:
    """Return the time from edge to verdict, its median and what 99.9 % do not exceed."""
    if not delays:
        return []
    target, worst_target = (1.0, 5.0) if one_process else (1.5, 8.0)
    usual = figure(
        f'edge to verdict, {what}',
        'ms',
        delays,
        reference=hop.median,
        target=target,
        reference_there=_HOP_THERE,
    )
    worst = figure(
        f'its 99.9 %, {what}', 'ms', [usual.worst], reference=hop.worst, target=worst_target
    )
    return [usual, worst]


def _share(begin: list[Usage], end: list[Usage]) -> float:
    """Return the processor time of a lane, % of one core."""
    return sum(
        100 * (after.cpu - before.cpu) / (after.when - before.when)
        for before, after in zip(begin, end, strict=True)
    )


def measure_replay(count: int, repetitions: int) -> list[Figure]:
    """Return how many times faster than real time a bag passes the graph, from item to item."""
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, 'bag')
        simulate = ['simulate', '--speed', '90', '--mass', '134.5', '--count', str(count)]
        run([*simulate, '--output', str(bag)])
        speeds, readings = [], []
        for _ in range(repetitions):
            begin = time.perf_counter()
            recording = read_bag(bag, None)
            reading = time.perf_counter() - begin
            duration = (recording.edges[-1].stamp - recording.edges[0].stamp) / 1e9
            readings.append(duration / reading)
            speeds.append(_replay_speed(bag))
    reference = statistics.median(readings)
    return [
        figure(
            'replay --rate 0',
            'x real time',
            speeds,
            reference=reference,
            target=100.0,
            more_is_better=True,
        )
    ]


def _replay_speed(bag: Path) -> float:
    child = subprocess.Popen(
        [*COMMAND, 'replay', str(bag), '--rate', '0'],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, 'PYTHONUNBUFFERED': '1'},
    )
    assert child.stdout is not None
    items = []
    for line in child.stdout:
        words = line.split()
        if (
            words
            and words[0].isdigit()
            and 'm/min' not in line
            and len(words) > 3
            and '.' in words[1]
        ):
            items.append((time.monotonic(), float(words[1])))
    if child.wait() != 0:
        raise RuntimeError('replay failed')
    (began, first), (ended, last) = items[0], items[-1]
    return (last - first) / (ended - began)


def measure_start(repetitions: int) -> list[Figure]:
    """Return how long --help and a node take from the call on."""
    helps, bare = [], []
    for _ in range(repetitions):
        for values, command in ((bare, [sys.executable, '-c', '']), (helps, [*COMMAND, '--help'])):
            begin = time.perf_counter()
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
            values.append(time.perf_counter() - begin)
    found = [
        figure('--help', 's', helps, reference=statistics.median(bare), target=0.3),
    ]
    for module in ('checkweigher_dsp.nodes.segmenter', 'checkweigher_bringup.line'):
        waits = [_ready(module) for _ in range(repetitions)]
        name = f'{module.rpartition(".")[2]} ready'
        found.append(figure(name, 's', waits, reference=statistics.median(bare), target=1.5))
    return found


def _ready(module: str) -> float:
    """Return how long a process takes until its nodes are there and wait for messages, s."""
    began = time.monotonic()
    child = subprocess.Popen(
        [sys.executable, str(HERE / 'waiting.py'), module, '--ros-args', '--log-level', 'error'],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    try:
        return float(child.stdout.readline()) - began
    finally:
        child.send_signal(signal.SIGINT)
        child.wait()


def cases(items: int, lanes: list[int], repetitions: int) -> dict[str, Callable[[], list[Figure]]]:
    """Return what can be measured, by name."""
    hops: list[Figure] = []

    def hop() -> list[Figure]:
        hops[:] = [measure_hop(1000)]
        return list(hops)

    def line(fewer: int = 1, **how: Any) -> list[Figure]:
        return measure_line(Trial(items // fewer, **how), (hops or hop())[0])

    return {
        'hop': hop,
        'line': line,
        'processes': lambda: line(one_process=False),
        # What a product costs, and what an empty belt.
        **{
            f'items{times}': lambda times=times: line(times, spacing=times * _SPACING)
            for times in ((2, 4) if lanes else ())
        },
        **{f'lanes{count}': lambda count=count: line(lanes=count) for count in lanes},
        'replay': lambda: measure_replay(600, repetitions),
        'batch': lambda: batch_figures(repetitions),
        'start': lambda: measure_start(repetitions),
    }  # type: ignore[dict-item]


def main() -> None:
    """Measure the cases that were asked for."""
    parser = argparse.ArgumentParser(description='How fast the graph is.')
    parser.add_argument('--only', default='', help='cases whose name has this in it')
    parser.add_argument('--items', type=int, default=1000, help='items of a line, 4.3 a second')
    parser.add_argument('--lanes', type=int, nargs='*', default=[4, 16], help='numbers of lanes')
    parser.add_argument('--repetitions', type=int, default=5, help='of replay and start')
    parser.add_argument('--quick', action='store_true', help='100 items, 2 repetitions, one lane')
    parser.add_argument('--json', type=Path, help='file to write the results to')
    given = parser.parse_args()
    if given.quick:
        given.items, given.lanes, given.repetitions = 100, [], 2
    known = cases(given.items, given.lanes, given.repetitions)
    chosen = {name: measure for name, measure in known.items() if given.only in name}
    if not chosen:
        parser.error(f'there is no case {given.only!r} in {", ".join(known)}')
    figures = []
    load = os.getloadavg()[0]
    for measure in chosen.values():
        figures += measure()
    print(table(figures))
    print(f'load {load:.1f} at the start, {os.getloadavg()[0]:.1f} at the end')
    if given.json:
        found = [{**asdict(each), 'verdict': each.verdict} for each in figures]
        write_json(given.json, load=[load, os.getloadavg()[0]], figures=found)


if __name__ == '__main__':
    main()
