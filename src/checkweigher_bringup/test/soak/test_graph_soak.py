# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many products through the real graph, without lost or repeated verdicts and memory leaks."""

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import time

from lines import simulated, weigh_all
import numpy as np
from processes import LINE, parameter_file, resident_memory
import pytest

from checkweigher_bringup.spinning import Process, node_command, running_processes, spinning
from checkweigher_core.records import StreamState, StreamStatus, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode

# 90 m/min, and each product enters soon after the one before it has left the belt.
CLOSE: dict[str, object] = {
    'speed': 1.5,
    'spacing': 0.35,
    'lead_in': 2.0,
    'start_time': 1_700_000_000,
}
# Not as fast as it goes: the diagnostics remember a minute, and by then a shift would be over.
RATE = 20.0
SETTLED = 7_000  # items, 80 s: results are kept for 1,000, and the reject stage remembers as many
# kB from then to the end. An entry in a dict that is kept of each of 18,000 items is 1,800,
# a record 9,000; an allocator that takes another piece now and then comes to some hundreds.
MAX_GROWTH = 1_500
# Two hours: CHECKWEIGHER_SOAK_SECONDS=7200.
SECONDS, LONG_RATE = float(os.environ.get('CHECKWEIGHER_SOAK_SECONDS', '300')), 10.0
MOST_MEMORY = 1_000_000  # kB
PATIENCE = 60.0  # s without a verdict
PERIOD = 1.0  # s, between two looks at the memory


class Witness(PortNode):
    """Listener with the verdicts of a line, and their expected number."""

    def __init__(self) -> None:
        super().__init__('witness')
        self.verdicts: list[Verdict] = []
        self.expected: int | None = None
        self.subscribe(ports.VERDICT, self.verdicts.append, qos=ports.VERDICT.qos)
        port = ports.SEGMENTER_STATUS
        self.subscribe(port, self._on_status, qos=port.qos)

    def _on_status(self, status: StreamStatus) -> None:
        if status.state is StreamState.FINISHED:
            self.expected = status.items

    @property
    def finished(self) -> bool:
        return self.expected is not None and len(self.verdicts) >= self.expected


class Memory:
    """Resident memory of processes in kB as a function of the number of items."""

    def __init__(self, processes: dict[str, Process]) -> None:
        self._processes = processes
        self.items: list[int] = []
        self.resident: dict[str, list[int]] = {name: [] for name in processes}

    def look(self, items: int) -> None:
        """Record the memory of each process."""
        self.items.append(items)
        for name, process in self._processes.items():
            self.resident[name].append(resident_memory(process.pid))

    def growth(self, name: str) -> int:
        """Return the growth in kB from the settled line to the end."""
        return self.resident[name][-1] - self.resident[name][self._settled]

    @property
    def _settled(self) -> int:
        return int(np.searchsorted(self.items, SETTLED))

    def report(self) -> str:
        """Return one line per process."""
        # That of a line that only takes longer to settle ends level, that of a leak does not.
        shown = np.unique(np.linspace(self._settled, len(self.items) - 1, 5).astype(int))
        passed = self.items[-1] - self.items[self._settled]
        return '\n'.join(
            f'  {name:10} RSS {values[0]} kB after {self.items[0]} items, '
            + ', '.join(f'{values[n]} after {self.items[n]}' for n in shown)
            + f'; {1000 * self.growth(name) / passed:+.1f} kB per 1,000 items'
            for name, values in self.resident.items()
        )


@contextmanager
def line(
    folder: Path, count: int, rate: float, *, one_process: bool
) -> Iterator[dict[str, Process]]:
    """Run the line on the simulator, faster than real time."""
    source = {f'simulator.{name}': value for name, value in CLOSE.items()}
    file = parameter_file(
        folder / 'parameters.yaml',
        {
            'driver': {'rate': rate, 'simulator.count': count, **source},
            'reject': {'deadlines': False},
        },
    )
    modules = {'line': LINE} if one_process else ports.NODES
    with running_processes(
        {name: node_command(module, '', file) for name, module in modules.items()}
    ) as processes:
        yield processes


def offline(count: int) -> list[Verdict]:
    """Weigh the same line without the graph."""
    return [weighing.verdict for weighing in weigh_all(simulated(**CLOSE, count=count))]


def shift(
    folder: Path, count: int, rate: float = RATE, *, one_process: bool
) -> tuple[list[Verdict], Memory]:
    """Run the line to its end, and return its verdicts in order of entry."""
    begin = time.monotonic()
    with spinning() as spinner:
        witness = Witness()
        spinner.add(witness)
        with line(folder, count, rate, one_process=one_process) as processes:
            memory = Memory(processes)
            judged, heard = 0, time.monotonic()
            while not witness.finished:
                time.sleep(PERIOD)
                if len(witness.verdicts) > judged:
                    judged, heard = len(witness.verdicts), time.monotonic()
                    memory.look(judged)
                assert time.monotonic() - heard < PATIENCE, f'silent after {judged} verdicts'
                ended = [name for name, process in processes.items() if process.poll() is not None]
                assert not ended, f'{ended} ended after {judged} verdicts'
        verdicts = sorted(witness.verdicts, key=lambda verdict: verdict.item_id)

    times = Counter(verdict.item_id for verdict in verdicts)
    missing = set(range(1, count + 1)) - set(times)
    doubled = [item for item, found in times.items() if found > 1]
    print(
        f'\n{count} items in {time.monotonic() - begin:.0f} s, {len(verdicts)} verdicts, '
        f'{len(missing)} missing, {len(doubled)} doubled, '
        f'{dict(Counter(verdict.decision.name for verdict in verdicts))}'
    )
    assert (missing, doubled, len(verdicts)) == (set(), [], count)
    return verdicts, memory


def test_150_items_have_the_verdicts_of_weigh(tmp_path: Path):
    verdicts, _ = shift(tmp_path, 150, one_process=True)
    assert verdicts == offline(150)


@pytest.mark.soak
@pytest.mark.parametrize(
    ('one_process', 'count'), [(True, 20_000), (False, 12_000)], ids=['one-process', 'processes']
)
def test_a_shift_has_the_verdicts_of_weigh_and_leaks_nothing(
    tmp_path: Path, one_process: bool, count: int
):
    verdicts, memory = shift(tmp_path, count, one_process=one_process)
    print(memory.report())
    assert verdicts == offline(count)
    for name in memory.resident:
        assert memory.growth(name) < MAX_GROWTH, f'{name} grows\n{memory.report()}'


@pytest.mark.soak
def test_hours_at_ten_times_the_pace(tmp_path: Path):
    spacing, speed = float(str(CLOSE['spacing'])), float(str(CLOSE['speed']))
    count = round(SECONDS * LONG_RATE * speed / spacing)

    _, memory = shift(tmp_path, count, LONG_RATE, one_process=False)

    print(memory.report())
    for name, resident in memory.resident.items():
        assert max(resident) < MOST_MEMORY, memory.report()
        assert memory.growth(name) < 0.1 * resident[-1], f'{name} grows\n{memory.report()}'
