"""Photo-eyes and rejector over Modbus TCP, against a server process on a real port."""

from contextlib import contextmanager
from dataclasses import replace
import json
from pathlib import Path
import socket
import subprocess
import sys
import threading
import time

import pytest

from checkweigher_driver.bag_reading import read_bag
from checkweigher_driver.line_io.modbus import (
    ModbusEyes,
    ModbusEyesParameters,
    ModbusOutputParameters,
    ModbusOutputs,
)
from checkweigher_driver.line_io.modbus_link import ModbusLink, ModbusLinkError
from checkweigher_driver.line_io.outputs import MachineOutputs, OutputParameters
from checkweigher_driver.sources import EyesBack, EyesLost
from checkweigher_dsp.line import LineParameters, WeighingLine
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import NANOSECONDS, Decision, EyeEdge, Verdict

PLC = Path(__file__).with_name('modbus_plc.py')
BAG = Path(__file__).parents[3] / 'bags/paper_90'
REJECTOR, RELEASE = 0, 1
MS = 1_000_000
PATIENCE = 10.0  # s, for what has to come


class Plc:
    """The server process, and what was written to its coils."""

    def __init__(self, folder):
        with socket.socket() as probe:
            probe.bind(('127.0.0.1', 0))
            self.port = probe.getsockname()[1]
        self.log = folder / f'coils_{self.port}.jsonl'
        self.process = None

    def start(self, *arguments):
        command = [sys.executable, PLC, '--port', self.port, '--log', self.log, *arguments]
        self.process = subprocess.Popen(
            [str(word) for word in command], stdout=subprocess.PIPE, text=True
        )
        word, began = self.process.stdout.readline().split()
        assert word == 'ready'
        return int(began)

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def switches(self, coil):
        """Return when a coil was switched (ns) and to what."""
        lines = [json.loads(line) for line in self.log.read_text().splitlines()]
        return [(when, value) for when, written, value in lines if written == coil]

    def state(self, coil):
        found = self.switches(coil) if self.log.exists() else []
        return found[-1][1] if found else None


@pytest.fixture
def plc(tmp_path):
    made = Plc(tmp_path)
    yield made
    if made.process.poll() is None:
        made.kill()


def wait_for(condition, what):
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, f'waited in vain for {what}'
        time.sleep(0.005)


@contextmanager
def reading(plc, **parameters):
    """Read the eyes in a thread, as the machine does; give the source and what it said."""
    eyes = ModbusEyes(ModbusEyesParameters(host='127.0.0.1', port=plc.port, **parameters))
    events = []

    def read():
        for event in eyes.events():
            events.append(event)

    thread = threading.Thread(target=read)
    thread.start()
    try:
        yield eyes, events
    finally:
        eyes.close()
        thread.join(PATIENCE)
        assert not thread.is_alive()


@contextmanager
def switching(plc, port_parameters=None, **parameters):
    port = ModbusOutputs(
        ModbusOutputParameters(
            host='127.0.0.1', port=plc.port, stop=RELEASE, watchdog=0, **(port_parameters or {})
        )
    )
    outputs = MachineOutputs(port, OutputParameters(**parameters))
    try:
        yield outputs
    finally:
        outputs.close()


def run(outputs):
    outputs.activate()
    outputs.stop_request(False)


def reject(item, due, decision=Decision.FAULT):
    return Verdict(item, due - 100 * MS, decision, reject_at=due)


def test_the_edges_of_a_bag_come_with_the_uncertainty_that_is_stated(plc):
    recording = read_bag(BAG)
    skipped = 1.5  # s, of two of empty belt
    begin = recording.blocks[0].stamp + round(skipped * NANOSECONDS)
    start = plc.start('--bag', BAG, '--skip', skipped)
    truth = [
        (edge.stamp - begin + start, edge.eye, edge.blocked)
        for edge in recording.edges
        if edge.stamp - begin < 2 * NANOSECONDS
    ]
    # However busy the machine is on which the test runs: no edge is to be lost for it.
    with reading(plc, max_uncertainty=0.5, longest_gap=1.0, timeout=1.0) as (eyes, events):
        wait_for(lambda: len(events) >= len(truth), 'all edges')
        figures = eyes.figures()
        assert eyes.trouble == ''

    found = [event for event in events if isinstance(event, EyeEdge)][: len(truth)]
    assert [(edge.eye, edge.blocked) for edge in found] == [(eye, on) for _, eye, on in truth]
    errors = [edge.stamp - stamp for edge, (stamp, _, _) in zip(found, truth, strict=True)]
    worst = max(map(abs, errors))
    stated = figures['largest edge uncertainty ms'] * MS
    print(f'{len(truth)} edges, worst error {worst / MS:.3f} ms, {figures}')
    assert worst <= stated
    assert figures['eye losses'] == 0
    assert figures['edge uncertainty ms'] == pytest.approx(
        (figures['poll period ms'] + figures['round trip ms']) / 2
    )


def test_a_device_that_dies_loses_the_eyes_and_comes_back_without_an_invented_edge(plc):
    plc.start()
    with reading(plc, timeout=0.1) as (eyes, events):
        wait_for(lambda: eyes.figures()['polls'] > 10, 'polls')
        plc.kill()
        wait_for(lambda: events, 'the loss')
        assert 'not read' in eyes.trouble
        assert f'127.0.0.1:{plc.port}' in eyes.trouble
        killed = time.time_ns()
        # It comes back in the middle of a product.
        recording = read_bag(BAG)
        entered, on = (edge.stamp - recording.blocks[0].stamp for edge in recording.edges[:2])
        plc.start('--bag', BAG, '--skip', 0.5 * (entered + on) / NANOSECONDS)
        wait_for(lambda: any(isinstance(event, EyesBack) for event in events), 'the eyes')
        wait_for(lambda: isinstance(events[-1], EyeEdge), 'an edge')

    lost, back = events[0], events[1]
    assert isinstance(lost, EyesLost)
    assert lost.stamp <= killed
    assert 'no connection' in lost.text or 'no answer' in lost.text
    assert isinstance(back, EyesBack)
    assert sum(isinstance(event, EyesLost) for event in events) == 1
    assert all(edge.stamp >= back.stamp - 10 * MS for edge in events[2:])
    assert eyes.trouble == ''


def test_a_device_that_is_not_there_is_waited_for(plc):
    with reading(plc, timeout=0.1) as (eyes, events):
        wait_for(lambda: events, 'the loss')
        assert 'check cable, address' in eyes.trouble
        plc.start()
        wait_for(lambda: isinstance(events[-1], EyesBack), 'the eyes')
        assert eyes.trouble == ''


def test_a_device_that_refuses_is_said_to(plc):
    plc.start()
    link = ModbusLink('127.0.0.1', plc.port, 1, 1.0)
    link.connect()
    with pytest.raises(ModbusLinkError, match='discrete input 900 cannot be read: the device ref'):
        link.read_bits('discrete', 900, 1)
    link.connect()
    assert link.read_bits('discrete', 0, 3) == [False, False, True]  # the belt runs
    link.close()


def test_the_rejector_is_switched_when_it_is_due(plc):
    plc.start('--watchdog', 0.5)
    # However busy the machine is on which the test runs: no pulse is to be lost for it.
    with switching(plc, {'timeout': 2.0}, pulse=0.2, late_tolerance=2.0) as outputs:
        wait_for(lambda: outputs.trouble == '', 'the connection')
        run(outputs)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        first = time.time_ns() + 200 * MS
        dues = [first + number * 400 * MS for number in range(5)]
        for number, due in enumerate(dues):
            outputs.verdict(reject(number + 1, due))
            outputs.verdict(reject(100 + number, due + 300 * MS, Decision.ACCEPT))
        wait_for(lambda: outputs.figures()['switches'] >= 10, 'the pulses')
        figures = outputs.figures()
        assert outputs.trouble == ''
    seen = [(when, on) for when, on in plc.switches(REJECTOR) if when > dues[0] - 50 * MS]
    assert [on for _, on in seen[:10]] == [True, False] * 5
    wanted = [due + length for due in dues for length in (0, 200 * MS)]
    late = [when - due for (when, _), due in zip(seen, wanted, strict=False)]
    print(f'switched {min(late) / MS:.3f} to {max(late) / MS:.3f} ms after it was due; {figures}')
    # Never early; and how late it was it knows itself.
    stated = figures['largest switch error ms'] + figures['switch uncertainty ms']
    assert 0 < min(late) <= max(late) <= (stated + 0.5) * MS
    assert figures['rejects'] == 5
    assert figures['late rejects'] == figures['output losses'] == 0


def test_each_reject_of_a_line_is_switched_at_its_time_and_no_accepted_item(plc):
    """A bag at true time: samples from the bag, eyes from the PLC, rejector at the PLC."""
    recording = read_bag(BAG)
    skipped = 1.5  # s, of two of empty belt
    start = plc.start('--bag', BAG, '--skip', skipped)
    shift = start - recording.blocks[0].stamp - round(skipped * NANOSECONDS)
    limits = {'reject.lower_limit': 0.12, 'reject.upper_limit': 0.2}
    line = WeighingLine(recording.load_cell, LineParameters().with_values(limits))
    verdicts = []
    with (
        reading(plc, max_uncertainty=0.2, longest_gap=1.0, timeout=1.0) as (_, events),
        switching(plc, {'timeout': 1.0}, late_tolerance=2.0) as outputs,
    ):
        run(outputs)
        taken = 0
        for block in recording.blocks:
            if len(verdicts) == 8:
                break
            stamp = block.stamp + shift
            end = stamp + len(block.counts) * NANOSECONDS / recording.load_cell.sample_rate
            time.sleep(max(end - time.time_ns(), 0) / NANOSECONDS)  # as a source blocks
            found = line.add(replace(block, stamp=stamp))
            while taken < len(events):
                found += line.add(events[taken])
                taken += 1
            for weighing in found:
                verdicts.append(weighing.verdict)
                outputs.verdict(weighing.verdict)
        rejects = [each for each in verdicts if each.decision != Decision.ACCEPT]
        last = max(each.reject_at for each in verdicts) + 200 * MS
        wait_for(lambda: time.time_ns() > last, 'the last item')
        figures = outputs.figures()
    # 74.5, 134.5, 164.5, 194.5 and 254.5 g in turn.
    assert [each.decision for each in verdicts] == [
        Decision.UNDER, Decision.ACCEPT, Decision.ACCEPT, Decision.ACCEPT, Decision.OVER,
        Decision.UNDER, Decision.ACCEPT, Decision.ACCEPT,
    ]  # fmt: skip
    # The first one ends the safe state, the last one begins it.
    ons = [when for when, on in plc.switches(REJECTOR) if on][1:-1]
    late = [when - each.reject_at for when, each in zip(ons, rejects, strict=True)]
    print(f'rejected {[f"{each / MS:.2f}" for each in late]} ms after the reject time; {figures}')
    stated = figures['largest switch error ms'] + figures['switch uncertainty ms']
    assert 0 < min(late) <= max(late) <= (stated + 0.5) * MS


def test_outputs_are_safe_before_they_are_active_and_after(plc):
    plc.start('--watchdog', 0.5)
    with switching(plc) as outputs:
        wait_for(lambda: plc.state(RELEASE) is not None, 'the first write')
        assert plc.state(REJECTOR) is True  # ejects
        assert plc.state(RELEASE) is False
        outputs.activate()
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the safe state')
        assert plc.state(RELEASE) is False  # nobody has said that the line may run
        outputs.stop_request(False)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        outputs.stop_request(True)
        wait_for(lambda: plc.state(RELEASE) is False, 'the stop')
        assert plc.state(REJECTOR) is False
        outputs.stop_request(False)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        outputs.safe()
        wait_for(lambda: plc.state(REJECTOR) is True, 'the safe state')
        run(outputs)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
    assert plc.state(REJECTOR) is True
    assert plc.state(RELEASE) is False


def test_a_verdict_that_comes_too_late_is_rejected_at_once_and_stops_the_line(plc):
    plc.start()
    with switching(plc, pulse=0.05) as outputs:
        wait_for(lambda: outputs.trouble == '', 'the connection')
        run(outputs)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        outputs.verdict(reject(7, time.time_ns() - 30 * MS))
        wait_for(lambda: plc.state(RELEASE) is False, 'the stop')
        assert 'item 7: its verdict came' in outputs.trouble
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the pulse')
        assert outputs.figures()['late rejects'] == 1
        outputs.reset()
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        assert outputs.trouble == ''
        outputs.verdict(Verdict(8, None, Decision.FAULT))
        wait_for(lambda: plc.state(RELEASE) is False, 'the stop')
        assert 'nobody knows when it is at the rejector' in outputs.trouble


def test_a_device_that_restarts_gets_the_safe_state_first_and_a_missed_reject_stops_the_line(plc):
    plc.start()
    with switching(plc, {'timeout': 0.1}, pulse=0.02) as outputs:
        wait_for(lambda: outputs.trouble == '', 'the connection')
        run(outputs)
        wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
        due = time.time_ns() + 300 * MS
        outputs.verdict(reject(1, due))
        plc.kill()
        wait_for(lambda: 'not reached' in outputs.trouble, 'the loss')
        wait_for(lambda: time.time_ns() > due + 50 * MS, 'the missed pulse')
        plc.log.unlink()
        plc.start()
        wait_for(lambda: 'look behind it' in outputs.trouble, 'the stop')
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the safe state')
        assert plc.switches(REJECTOR)[0][1] is True
        assert [on for _, on in plc.switches(RELEASE)] == [False]
        assert outputs.figures()['output losses'] == 1


def test_a_master_that_dies_leaves_outputs_that_go_safe(plc, tmp_path):
    plc.start('--watchdog', 0.2)
    program = tmp_path / 'master.py'
    program.write_text(
        'import sys, time\n'
        'from checkweigher_driver.line_io import prepare_outputs\n'
        'values = {"modbus_outputs": {"host": "127.0.0.1", "port": int(sys.argv[1]), "stop": 1,\n'
        '                             "watchdog": 0}, "rejector": {}}\n'
        'prepared = prepare_outputs("modbus", lambda kind: kind.from_mapping(values[kind.node]))\n'
        'outputs = prepared()\n'
        'outputs.activate()\n'
        'outputs.stop_request(False)\n'
        'time.sleep(60)\n'
    )
    with subprocess.Popen([sys.executable, str(program), str(plc.port)]) as master:
        try:
            wait_for(lambda: plc.state(RELEASE) is True, 'the release of the belt')
            assert plc.state(REJECTOR) is False
        finally:
            master.kill()
        killed = time.time_ns()
        wait_for(lambda: plc.state(RELEASE) is False, 'the watchdog')
    assert plc.state(REJECTOR) is True
    print(f'safe {(plc.switches(RELEASE)[-1][0] - killed) / MS:.0f} ms after the master died')


def test_the_belt_input_holds_the_rejector_back(plc):
    plc.start()
    link = ModbusLink('127.0.0.1', plc.port, 1, 1.0)
    link.connect()
    with switching(plc, {'belt': 2}, pulse=0.1, belt_margin=0.0, late_tolerance=5.0) as outputs:
        wait_for(lambda: outputs.trouble == '', 'the connection')
        run(outputs)
        wait_for(lambda: outputs.belt_runs is True and plc.state(REJECTOR) is False, 'the belt')
        due = time.time_ns() + 400 * MS
        outputs.verdict(reject(1, due))
        link.write_register(1, 1)
        wait_for(lambda: outputs.belt_runs is False, 'the stop')
        wait_for(lambda: time.time_ns() > due + 200 * MS, 'the time without the stop')
        assert plc.state(REJECTOR) is False
        link.write_register(1, 0)
        wait_for(lambda: plc.state(REJECTOR) is True, 'the pulse')
        assert outputs.trouble == ''
    link.close()


@pytest.mark.parametrize(
    ('kind', 'values', 'message'),
    [
        (ModbusEyesParameters, {'host': ' '}, r'modbus\.host: empty'),
        (ModbusEyesParameters, {'outfeed': 0}, r'modbus\.outfeed: 0 is the infeed eye as well'),
        (ModbusEyesParameters, {'outfeed': 64}, r'one request cannot read both'),
        (ModbusEyesParameters, {'poll_period': 0.05}, r'less certain than'),
        (ModbusOutputParameters, {'stop': 0}, r'modbus_outputs\.stop: coil 0 is the rejector'),
    ],
)
def test_parameters_that_cannot_be_are_refused(kind, values, message):
    with pytest.raises(ParameterError, match=message):
        kind(**values)
