# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Faults with a bad product on the belt, which is rejected, or the belt stops for a person.

The machine is `belt_machine.py`, whose PLC runs the program of docs/hardware_io.md; the line is
that of the command `run`. A trial feeds a bad product among good ones, lets a fault happen when it
is at some place, and follows it: once the belt is released again without a person, or nobody is
told, a bad product behind the rejector has escaped. Then the operator clears the belt and presses
the button, and good products have to be weighed again.
"""

from argparse import Namespace
import asyncio
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
import os
from pathlib import Path
import random
import re
import signal
import time

from belt_line import GOOD, HEAVY, LIGHT, BeltLine, belt_line
from belt_machine import RELEASE, Machine, Product, Server
from checkweigher_msgs.msg import Verdict
from lifecycle_msgs.msg import Transition
import pytest
from running import PATIENCE

# Of each campaign: CHECKWEIGHER_EXAMPLES=500 make soak SOAK_ARGS='-k test_held_belt'
TRIALS = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '40'))
# Shards of a campaign that run side by side count from 0: each goes on where the one before ends.
SHARD = int(os.environ.get('CHECKWEIGHER_SHARD', '0'))
REACHES_REJECTOR = (-0.05, 0.65)  # m behind the infeed eye, where a fault finds the bad product
NODES = ('driver', 'reject', 'segmenter', 'denoise', 'identifier')
DEACTIVATE, ACTIVATE = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_ACTIVATE
WHOLE = 10  # good products that have to be weighed after a fault of a campaign
# s for it: where the host is busy the eyes are read late, and the line stops again and again.
WEIGHED = 5 * PATIENCE


@dataclass(frozen=True)
class Fault:
    """Kind of fault. If `stops` is True, the line must stop in any case."""

    name: str
    happen: Callable[[BeltLine, random.Random], None]
    stops: bool = False


def killed(node: str) -> Fault:
    def happen(line: BeltLine, rng: random.Random) -> None:
        line.signal(node, signal.SIGKILL)

    return Fault(f'{node} killed', happen, stops=node in ('driver', 'line'))


def halted(node: str) -> Fault:
    def happen(line: BeltLine, rng: random.Random) -> None:
        pid = line.signal(node, signal.SIGSTOP)
        time.sleep(rng.uniform(0.1, 2.0))
        os.kill(pid, signal.SIGCONT)

    return Fault(f'{node} halted', happen)


def deactivated(node: str) -> Fault:
    def happen(line: BeltLine, rng: random.Random) -> None:
        assert line.change(node, DEACTIVATE)
        time.sleep(rng.uniform(0.0, 1.0))
        assert line.change(node, ACTIVATE)

    return Fault(f'{node} deactivated', happen)


def killed_in_turn(line: BeltLine, rng: random.Random) -> None:
    line.signal('driver', signal.SIGKILL)
    line.wait_for(lambda: 'look' in line.stop_text(), 'the latched stop')
    time.sleep(rng.uniform(0.0, 1.0))
    said = len(line.stops)
    line.signal('reject', signal.SIGKILL)
    line.wait_for(lambda: len(line.stops) > said, 'the word of another reject')
    time.sleep(1.0)


def interrupted(line: BeltLine, rng: random.Random) -> None:
    line.stop()
    line.start()


def all_killed(line: BeltLine, rng: random.Random) -> None:
    assert line.command is not None
    nodes = NODES if line.processes else ('line',)
    left = [pid for node in (*nodes, 'product') for pid in line.pids(node)]
    line.command.kill()
    line.command.wait()
    time.sleep(rng.uniform(0.0, 1.0))
    for pid in left:
        if Path(f'/proc/{pid}').exists():
            os.kill(pid, signal.SIGKILL)
    line.wait_for(lambda: not any(Path(f'/proc/{pid}').exists() for pid in left), 'the end')


def supervisor_killed(line: BeltLine, rng: random.Random) -> None:
    all_killed(line, rng)
    line.start()


def state_damaged(line: BeltLine, rng: random.Random) -> None:
    """Damage or remove the record of the belt, or the numbers of the segmenter or of reject."""
    all_killed(line, rng)
    path = rng.choice([line.record, line.folder / 'items', line.folder / 'verdicts'])
    data = bytearray(path.read_bytes())
    begin, end = sorted(rng.sample(range(data.index(b'\n')), 2))
    data[begin:end] = rng.choice((b'', b'\0' * (end - begin), rng.randbytes(end - begin)))
    path.write_bytes(rng.choice((b'', data[:begin], data, data)))
    if rng.random() < 0.2:
        path.unlink()
    line.start()


def told(name: str, *choices: str) -> Fault:
    """Return a fault that is reported to the machine."""

    def happen(line: BeltLine, rng: random.Random) -> None:
        line.tell(rng.choice(choices).format(rng.uniform(0.05, 1.5)))
        if name == 'PLC answers late':
            time.sleep(1.0)
            line.tell('late 0')
        elif name == 'load cell unplugged':
            time.sleep(rng.uniform(0.1, 1.0))
            line.tell('replug')

    return Fault(name, happen)


DAMAGED = Fault('line killed, state damaged', state_damaged, stops=True)
OF_ALL = [
    deactivated('driver'),
    deactivated('reject'),
    Fault('supervisor killed', supervisor_killed, stops=True),
    Fault('line interrupted', interrupted, stops=True),
    DAMAGED,
]
IN_ONE_PROCESS = [killed('line'), halted('line'), *OF_ALL]
IN_PROCESSES = [
    *(killed(node) for node in NODES),
    *(halted(node) for node in NODES),
    *OF_ALL,
    Fault('driver killed, then reject', killed_in_turn, stops=True),
]
DEVICES = [
    told('PLC does not answer', 'mute {}'),
    told('PLC answers late', 'late 0.03', 'late 0.1'),
    told('PLC drops the connection', 'drop', 'drop {}'),
    told('PLC restarts', 'restart {}'),
    told('load cell unplugged', 'unplug'),
    told('load cell silent', 'silence {}'),
    told('serial bytes lost', 'lose 7', 'lose 700', 'corrupt', 'junk 9'),
]


class Trials:
    """Trials on one line, and their counts."""

    def __init__(self, line: BeltLine, seed: int, whole: int) -> None:
        self._line, self._whole = line, whole
        self._rng = random.Random(seed)
        self.counts: Counter[str] = Counter()
        self.start()

    def start(self) -> None:
        """Wait for the release of the belt after a start without a fault."""
        line, said = self._line, len(self._line.stops)
        self.operate()  # a busy host may have read the eyes late
        assert not [stop.hint for stop in line.stops[said:] if 'look for' in stop.hint]

    def run(self, fault: Fault) -> None:
        """Cause a fault with a bad product on the belt, and recover."""
        line, rng = self._line, self._rng
        bad, place = rng.choice((LIGHT, HEAVY)), rng.uniform(*REACHES_REJECTOR)
        self.weigh(2)
        self._bring(bad, place, rng.choice((0, 0, 1, 3)))
        began, heard = time.time_ns(), len(line.stops)
        fault.happen(line, rng)
        outcome = self._follow(fault, bad, began)
        self.counts['tried'] += 1
        self.counts[outcome] += 1
        print(f'{fault.name}, {bad:g} g at {place:.2f} m: {outcome}; {line.stop_text()[-120:]}')
        assert 'escaped' not in outcome, (fault.name, bad, place, line.stop_text(), line.events())
        self.operate()
        if outcome != 'ejected':
            hints = [stop.hint for stop in line.stops[heard:]]
            self.counts['named'] += any(re.search(r'item \d|without a verdict', h) for h in hints)
        first = self.weigh(self._whole)
        self.counts['recovered'] += 1
        self.counts['second product weighed'] += first <= 2

    def _bring(self, bad: float, place: float, behind: int) -> None:
        """Feed a bad product between good ones, and wait until it is at a place in m."""
        line, fed = self._line, 0

        def there() -> bool:
            nonlocal fed
            if fed and line.stop_text():
                self.operate_again()
                fed = 0
            if not fed:
                fed = time.time_ns()
                line.feed(GOOD, bad, *([GOOD] * behind))
            return self._place(bad, fed) > place and not line.stop_text()

        line.wait_for(there, f'{bad} g at {place:.2f} m')

    def operate_again(self) -> None:
        """Release a belt that has stopped for another reason than the fault, and count the stop."""
        self.counts['stopped again'] += 1  # a product was cut off, or the host was too busy
        print(f'stopped again: {self._line.stop_text()[-160:]}')
        self.operate()

    def _place(self, mass: float, since: int) -> float:
        """Return the place of a product in m from mass and feed time; 1 if behind the rejector."""
        for _, _, place, _ in (p for p in self._line.products() if p[1] == mass):
            return place
        gone = (entry for entry in self._line.events() if entry[0] > since and entry[2:])
        return 1.0 if any(entry[3] == mass for entry in gone) else -1.0

    def _follow(self, fault: Fault, bad: float, began: int) -> str:
        """Return the outcome for the bad product."""
        line, since = self._line, time.monotonic()
        passed = ejected = text = ''
        while time.monotonic() - since < WEIGHED:  # nodes that were killed take long to start
            time.sleep(0.05)
            events = [entry for entry in line.events() if entry[0] > began]
            fates = {entry[1]: entry[0] for entry in events if entry[2:] and entry[3] == bad}
            passed, ejected = fates.get('passed', 0), fates.get('ejected', 0)
            if passed and any(e[1] == 'run' and e[0] < passed for e in events):
                return 'escaped: the belt was released with it'
            text = line.stop_text()
            stopped = bool(text) and 'NotReady' not in text and not line.runs()
            if stopped and (not passed or 'look' in text):
                return 'held, behind the rejector' if passed else 'held'
            quiet = line.runs() and not text and time.monotonic() - since > 3.0
            if quiet and not fault.stops and ejected:
                return 'ejected'
        return f'escaped: nobody was told: {passed=} {ejected=} {text=}'

    def operate(self) -> None:
        """Clear a stopped belt and press the button, until the belt runs and is empty."""
        line = self._line
        line.feed(0)

        def released() -> bool:
            if line.stop_text():
                line.tell('clear')
                line.reset()
            time.sleep(0.1)
            return line.runs() and not line.products()

        line.wait_for(released, 'the release of the belt')

    def weigh(self, count: int) -> int:
        """Weigh good products until enough in a row are accepted, and return the first of all."""
        line, first = self._line, len(self._line.verdicts)
        line.feed(*([GOOD] * count))

        def weighed() -> bool:
            verdicts = line.verdicts[first:]
            for verdict in verdicts:
                if verdict.decision != Verdict.FAULT:
                    assert abs(1e3 * verdict.mass - GOOD) < 1.0
            good = [verdict.decision == Verdict.ACCEPT for verdict in verdicts]
            if len(good) >= count and all(good[-count:]):
                return True
            if line.stop_text():
                self.operate_again()
            if not line.tell('products')['to come']:
                line.feed(GOOD)
            return False

        line.wait_for(weighed, f'{count} good products', WEIGHED)
        self.counts['good'] += count
        self.operate()
        decisions = [verdict.decision for verdict in line.verdicts[first:]]
        return 1 + decisions.index(Verdict.ACCEPT)


def hold(
    folder: Path,
    faults: list[Fault],
    *,
    processes: bool,
    wiring: str,
    seed: int = 1,
    again: bool = False,
    whole: int = WHOLE,
) -> None:
    """Cause each of the faults, and print the outcomes.

    With `again`, end with an empty belt, and start the line `again`, which needs no person.
    """
    options = {'processes': processes, 'wiring': wiring}
    if wiring == 'permit':  # with more time between products than the watchdog has
        options |= {'outputs': ', permit: 2', 'spacing': 0.45}
    with belt_line(folder, **options) as line:
        trials = Trials(line, seed, whole)
        try:
            for fault in faults:
                trials.run(fault)
            if again:
                line.wait_for(lambda: not line.recorded(), 'the record of an empty belt')
                line.stop()
                line.start()
                trials.start()
        finally:
            way = 'a process per node' if processes else 'one process'
            print(f'{way}, wired by {wiring}: {dict(sorted(trials.counts.items()))}')
    assert trials.counts['recovered'] == len(faults)
    if wiring == 'permit':
        assert trials.counts['held, behind the rejector'] == 0


def test_the_machine_shows_its_eyes_as_they_are_at_the_request(tmp_path: Path):
    files = {'link': tmp_path / 'cell', 'log': tmp_path / 'events'}
    given = Namespace(**files, wiring='reject', watchdog=60.0, speed=0.02, spacing=0.25)
    machine = Machine(given)  # which has no turn
    machine.plc.coils[RELEASE], machine.plc.heartbeat = True, 1
    machine.belt.products.append(Product(1, GOOD, -0.001))
    time.sleep(0.3)

    inputs = [0]
    asyncio.run(Server(machine, 0).act(2, 0, 0, 3, inputs, None))

    assert inputs == [0b101]  # a product at the infeed eye, and the belt runs
    machine.port.unplug()


@pytest.mark.soak
def test_a_line_that_is_killed_holds_the_belt_until_a_person_has_looked(tmp_path: Path):
    hold(tmp_path, [killed('line')], processes=False, wiring='reject', again=True)


def test_a_node_that_is_killed_lets_no_bad_product_pass(tmp_path: Path):
    hold(tmp_path, [killed('driver')], processes=True, wiring='reject', whole=3)


@pytest.mark.soak
def test_what_is_not_permitted_does_not_pass(tmp_path: Path):
    hold(tmp_path, [deactivated('reject')], processes=False, wiring='permit')


def share(kinds: list[Fault]) -> list[Fault]:
    """Return the faults of one of four lines in this shard."""
    count = TRIALS // 4
    return [kinds[number % len(kinds)] for number in range(SHARD * count, (SHARD + 1) * count)]


@pytest.mark.soak
@pytest.mark.parametrize('wiring', ['reject', 'permit'])
@pytest.mark.parametrize('processes', [False, True])
def test_kills_and_halts(tmp_path: Path, *, processes: bool, wiring: str):
    faults = share(IN_PROCESSES if processes else IN_ONE_PROCESS)
    hold(tmp_path, faults, processes=processes, wiring=wiring, seed=TRIALS + SHARD)


@pytest.mark.soak
@pytest.mark.parametrize('wiring', ['reject', 'permit'])
@pytest.mark.parametrize('processes', [False, True])
def test_faults_of_plc_and_load_cell(tmp_path: Path, *, processes: bool, wiring: str):
    hold(tmp_path, share(DEVICES), processes=processes, wiring=wiring, seed=TRIALS + SHARD)


@pytest.mark.soak
@pytest.mark.parametrize('wiring', ['reject', 'permit'])
@pytest.mark.parametrize('processes', [False, True])
def test_damaged_state(tmp_path: Path, *, processes: bool, wiring: str):
    faults = [DAMAGED] * (TRIALS // 4)
    hold(tmp_path, faults, processes=processes, wiring=wiring, seed=TRIALS + SHARD, whole=3)
