# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands `record` and `echo` on a running graph, each in its own process."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
import random
import signal
import subprocess

from graph import wait_for
from lines import counts_of, simulated, write_line
import numpy as np
import pytest
from rclpy.node import Node
from rclpy.publisher import Publisher
from running import Rows, read_rows, run_command, start_command
import yaml

from checkweigher_bringup.recorder import RecorderNode, ReferencePasses
from checkweigher_bringup.spinning import spinning
from checkweigher_core.recording import Event, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    LoadCell,
    SampleBlock,
    Verdict,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.port_node import PortNode
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import read_bag

RATE = 4
COUNT = 12
BEYOND = 40  # events that come when a recorder is killed


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_line(tmp_path_factory.mktemp('line') / 'bag', simulated(count=COUNT))


@contextmanager
def started(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Run a command for the duration of the block."""
    process = start_command(*arguments)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.parametrize('processes', [False, pytest.param(True, marks=pytest.mark.soak)])
def test_a_recording_of_a_replay_is_whole(bag: Path, rows: Rows, tmp_path: Path, processes: bool):
    flags = ['--processes'] if processes else []
    with started('record', '--output', tmp_path / 'bag', '--namespace', 'taped') as recorder:
        replayed = rows(
            'replay', bag, '--rate', RATE, '--namespace', 'taped', '--listeners', 1, *flags
        )
        recorder.send_signal(signal.SIGINT)
        output, errors = recorder.communicate(timeout=60)
    assert recorder.returncode == 0, errors
    assert 'messages' in output
    recording, original = read_bag(tmp_path / 'bag'), read_bag(bag)
    assert np.array_equal(counts_of(recording), counts_of(original))
    assert (recording.edges, recording.references) == (original.edges, original.references)
    assert rows('weigh', tmp_path / 'bag') == replayed
    information = yaml.safe_load((tmp_path / 'bag/metadata.yaml').read_text())
    topics = information['rosbag2_bagfile_information']['topics_with_message_count']
    counts = {each['topic_metadata']['name']: each['message_count'] for each in topics}
    if not processes:  # the driver is with the recorder; the other processes may be later
        for name in ('weigh_window', 'denoised_window', 'mass_estimate', 'verdict'):
            assert counts[f'/taped/{name}'] == COUNT
    assert counts['/diagnostics'] > 0
    assert {'/taped/statistics', '/taped/zero_setting', '/taped/reject_eye'} <= set(counts)


def check_killed(line: Recording, folder: Path, moments: Sequence[int]) -> list[int]:
    """Send a line, kill a recorder at each of the moments, and weigh the bag that it has left.

    A moment is a number of events: a recorder is killed when it has written this number, while
    further events arrive. Returns the items that could be weighed, for each moment.
    """
    write_line(folder / 'line', line)
    events = list(line)
    with ExitStack() as stack:
        recorders = [
            stack.enter_context(
                started('record', '--output', folder / f'killed{n}', '--namespace', 'killed')
            )
            for n in range(len(moments))
        ]
        spinner = stack.enter_context(spinning('killed'))
        feeder = Feeder(line.load_cell)
        spinner.add(feeder)
        wait_for(lambda: feeder.listeners() == len(moments))
        feeder.begin()
        sent = 0
        for n, moment in enumerate(moments):
            feeder.send(events[sent:moment])
            wait_for(lambda: written(folder / f'killed{n}') >= moment)  # noqa: B023
            sent = moment + BEYOND
            feeder.send(events[moment:sent])
            recorders[n].kill()
    whole = read_rows(weigh(folder / 'line', folder)[0])
    weighed = []
    for n in range(len(moments)):
        path, notice = weigh(folder / f'killed{n}', folder)
        assert f'{folder / f"killed{n}"}: the recording broke off' in notice
        rows = read_rows(path)
        weighed.append(sum('StreamEnded' not in row['reasons'] for row in rows))
        check_beginning(rows, whole, weighed[-1])
    return weighed


class Feeder(Node):
    """Driver of a line whose events the test sends."""

    def __init__(self, load_cell: LoadCell) -> None:
        super().__init__('feeder')
        self._info = to_message(ports.LOAD_CELL_INFO, load_cell, stamp=0)
        self._begin = self._publisher_of(ports.LOAD_CELL_INFO)
        self._of = {port.record: (self._publisher_of(port), port) for port in ports.PLAYED[1:]}

    def _publisher_of(self, topic: ports.Port) -> Publisher:
        return self.create_publisher(topic.type, topic.name, topic.qos)

    def listeners(self) -> int:
        """Return how many take all of it."""
        publishers = [self._begin, *(publisher for publisher, _ in self._of.values())]
        return min(publisher.get_subscription_count() for publisher in publishers)

    def begin(self) -> None:
        self._begin.publish(self._info)

    def send(self, events: Sequence[Event]) -> None:
        for event in events:
            publisher, port = self._of[type(event)]
            publisher.publish(to_message(port, event))


def written(folder: Path) -> int:
    """Return how many events a recorder has written up to now."""
    try:
        return sum(1 for _ in read_bag(folder))
    except BagError:
        return 0


def weigh(bag: Path, folder: Path) -> tuple[Path, str]:
    """Weigh a bag, and return the CSV and the text on stderr."""
    path = folder / f'{bag.name}.csv'
    done = run_command('weigh', bag, '--csv', path)
    assert done.returncode == 0, done.stderr
    return path, done.stderr


def check_beginning(rows: list[dict[str, str]], whole: list[dict[str, str]], count: int) -> None:
    """Check that the first `count` rows are those of the whole line, and then the last items."""
    assert all('StreamEnded' in row['reasons'] for row in rows[count:])
    assert all(not row['mass_g'] and row['decision'] == 'FAULT' for row in rows[count:])
    assert len(rows) - count <= 2
    expected = [dict(row) for row in whole[:count]]
    if rows[:count]:
        for last in (rows[count - 1], expected[-1]):
            del last['t4']  # which may lie behind the cut
    assert rows[:count] == expected


def passed(line: Recording, moment: int) -> int:
    """Return how many items have come to the outfeed eye, and their samples, by a moment."""
    return sum(
        isinstance(event, EyeEdge) and event.eye is Eye.OUTFEED and event.blocked
        for event in list(line)[: moment - 5]
    )


@pytest.mark.parametrize(
    'seed', [0, *(pytest.param(seed, marks=pytest.mark.soak) for seed in range(1, 8))]
)
def test_a_recording_that_was_killed_weighs_up_to_the_cut(tmp_path: Path, seed: int):
    line = simulated(count=15, spacing=0.4, seed=seed)
    last = len(list(line)) - BEYOND
    moments = sorted(random.Random(seed).sample(range(BEYOND, last, BEYOND), 3))

    weighed = check_killed(line, tmp_path, moments)

    expected = [passed(line, moment) for moment in moments]
    print(f'\nitems that had passed, and items weighed after the kill: {expected}, {weighed}')
    assert all(found >= least for found, least in zip(weighed, expected, strict=True))
    assert expected[0] < expected[2]


def test_echo_shows_each_verdict_of_its_lane_and_no_other(bag: Path):
    with (
        started('echo', '--namespace', 'seen', '--count', '5') as seen,
        started('echo', '--namespace', 'other') as other,
    ):
        wait_for_node('/seen/echo', '/other/echo')
        done = run_command('replay', bag, '--rate', 1, '--namespace', 'seen')
        assert done.returncode == 0, done.stderr
        output, errors = seen.communicate(timeout=60)
        assert seen.returncode == 0, errors
        lines = output.splitlines()
        # However late DDS has brought the two together.
        assert [int(line.split()[0]) for line in lines[1:6]] == [1, 2, 3, 4, 5]
        assert lines[6].startswith('5 items, 5 ACCEPT')
        assert other.stderr is not None
        assert 'waiting for verdicts on /other/verdict' in other.stderr.readline()
        silence = other.stderr.readline()
        other.send_signal(signal.SIGINT)
        rows_of_other, _ = other.communicate(timeout=60)
    assert rows_of_other == ''
    assert 'no node publishes /other/load_cell/samples' in silence


def test_passes_of_a_known_mass_are_recorded_with_it(bag: Path, rows: Rows, tmp_path: Path):
    with started(
        'record', '--output', tmp_path / 'bag', '--namespace', 'known', '--reference', 150,
        '--passes', 3,
    ) as recorder:  # fmt: skip
        replayed = rows('replay', bag, '--rate', RATE, '--namespace', 'known', '--listeners', 1)
        output, errors = recorder.communicate(timeout=60)
    assert recorder.returncode == 0, errors
    assert '3 passes' in output
    assert 'pass 3 of 3' in output + errors
    # What the line itself says of its masses is not in the bag.
    masses = [(row['t1'], row['reference_g']) for row in rows('weigh', tmp_path / 'bag')]
    known = [t1 for t1, reference in masses if reference]
    assert [reference for _, reference in masses if reference] == ['150.000000'] * 3
    times = [row['t1'] for row in replayed]
    assert known == times[times.index(known[0]) :][:3]


def wait_for_node(*names: str) -> None:
    with spinning() as spinner:
        node = Node('watcher')
        spinner.add(node)

        def known() -> set[str]:
            pairs = node.get_node_names_and_namespaces()
            return {f'{space.rstrip("/")}/{own}' for own, space in pairs}

        wait_for(lambda: known().issuperset(names))


def test_a_pass_counts_only_if_its_signal_is_recorded():
    passes = ReferencePasses(0.1, 5)
    with spinning() as spinner:
        node = RecorderNode((ports.LOAD_CELL_SAMPLES,), passes)
        line = PortNode('line')
        samples, verdicts = map(line.output, (ports.LOAD_CELL_SAMPLES, ports.VERDICT))
        spinner.add(line)
        spinner.add(node)
        for output in (samples, verdicts):
            wait_for(lambda output=output: output.publisher.get_subscription_count())

        def send(item_id: int, t1: int) -> None:
            verdicts.send(Verdict(item_id, t1 + NANOSECONDS, Decision.ACCEPT, t1=t1, mass=0.1))

        begin = 100 * NANOSECONDS
        send(1, begin - NANOSECONDS)  # before the first samples
        samples.send(SampleBlock(begin, 0, np.zeros(96, np.int32)))
        wait_for(lambda: not node.messages.empty())
        send(2, begin - 1)  # on the belt when the recording began
        send(3, begin + NANOSECONDS)
        wait_for(lambda: passes.count)
    assert passes.count == 1
    assert list(passes.lines()) == ['pass 1 of 5: 100.000 g, +0.000 g']
