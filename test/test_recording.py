"""Recording and listening to a running graph, each in a process of its own."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
import csv
from pathlib import Path
import random
import signal
import subprocess
import sys

from checkweigher_msgs.msg import LoadCellSamples, PhotoEyeEvent, Verdict
from lines import counts_of, simulated
import numpy as np
import pytest
from rclpy.node import Node
from running import run_command
from test_nodes import wait_for
import yaml

from checkweigher_bringup.spinning import spinning
from checkweigher_driver.bag_messages import BagError
from checkweigher_driver.bag_reading import read_bag
from checkweigher_driver.bag_writing import write_bag
from checkweigher_driver.recording import Recording
from checkweigher_dsp.nodes import topics

MODULE = [sys.executable, '-m', 'checkweigher_bringup.cli']

RATE = 4
COUNT = 12
KILLED = 3  # recorders beside one line


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    line = simulated(count=COUNT)
    path = tmp_path_factory.mktemp('line') / 'bag'
    write_bag(path, line.load_cell, line)
    return path


@contextmanager
def started(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """Have a command running for as long as the block lasts."""
    process = subprocess.Popen(
        [*MODULE, *map(str, arguments)], text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.parametrize('processes', [False, True])
def test_a_recording_of_a_replay_is_whole(
    bag: Path, rows: Callable[..., list[dict[str, str]]], tmp_path: Path, processes: bool
):
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
    for name in ('weigh_window', 'denoised_window', 'mass_estimate', 'verdict'):
        assert counts[f'/taped/{name}'] == COUNT
    assert counts['/diagnostics'] > 0
    assert {'/taped/statistics', '/taped/zero_setting', '/taped/reject_eye'} <= set(counts)


class Watcher(Node):
    """Sees what happens on a line."""

    def __init__(self) -> None:
        super().__init__('watcher')
        self.blocks = self.edges = self.judged = 0
        self.on_belt = False
        for topic, take in (
            (topics.PHOTO_EYES, self._on_edge), (topics.VERDICT, self._on_verdict),
            (topics.LOAD_CELL_SAMPLES, self._on_block),
        ):  # fmt: skip
            self.create_subscription(topic.type, topic.name, take, topic.stage_qos)

    def _on_edge(self, message: PhotoEyeEvent) -> None:
        self.edges += 1
        if message.eye == PhotoEyeEvent.INFEED and message.blocked:
            self.on_belt = True
        elif message.eye == PhotoEyeEvent.OUTFEED and not message.blocked:
            self.on_belt = False

    def _on_verdict(self, message: Verdict) -> None:
        self.judged += 1

    def _on_block(self, message: LoadCellSamples) -> None:
        self.blocks += 1


def check_killed(
    line: Recording, rate: float, folder: Path, moments: Sequence[Callable[[Watcher], bool]]
) -> list[tuple[int, int]]:
    """Replay a line, kill a recorder with SIGKILL at each moment, and weigh what it has left.

    The moments come one after the other. Return the verdicts that had been given at each of them,
    and the items that could be weighed afterwards.
    """
    write_bag(folder / 'line', line.load_cell, line)
    judged = []
    with ExitStack() as stack:
        recorders = [
            stack.enter_context(
                started('record', '--output', folder / f'killed{n}', '--namespace', 'killed')
            )
            for n in range(len(moments))
        ]
        spinner = stack.enter_context(spinning('killed'))
        watcher = Watcher()
        spinner.add(watcher)
        replay = stack.enter_context(
            started('replay', folder / 'line', '--rate', rate, '--namespace', 'killed',
                    '--listeners', len(moments) + 1, '--csv', folder / 'line.csv')
        )  # fmt: skip
        for recorder, moment in zip(recorders, moments, strict=True):
            wait_for(lambda: moment(watcher), 60.0)  # noqa: B023
            recorder.kill()
            judged.append(watcher.judged)
        _, errors = replay.communicate(timeout=60)
        assert replay.returncode == 0, errors
    whole = read_rows(folder / 'line.csv')
    weighed = []
    for n in range(len(moments)):
        done = run_command('weigh', folder / f'killed{n}', '--csv', folder / f'{n}.csv')
        assert done.returncode == 0, done.stderr
        (notice,) = done.stderr.splitlines()
        assert f'{folder / f"killed{n}"}: the recording broke off' in notice
        rows = read_rows(folder / f'{n}.csv')
        weighed.append(sum('StreamEnded' not in row['reasons'] for row in rows))
        check_beginning(rows, whole, weighed[-1])
    return list(zip(judged, weighed, strict=True))


def check_beginning(rows: list[dict[str, str]], whole: list[dict[str, str]], count: int) -> None:
    """Check that rows are the first `count` of the whole line, and then what was on the belt."""
    assert all('StreamEnded' in row['reasons'] for row in rows[count:])
    assert all(not row['mass_g'] and row['decision'] == 'FAULT' for row in rows[count:])
    assert len(rows) - count <= 2
    expected = [dict(row) for row in whole[:count]]
    if rows[:count]:
        for last in (rows[count - 1], expected[-1]):
            del last['t4']  # which may lie behind the cut
    assert rows[:count] == expected


def read_rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def have_begun(folder: Path) -> bool:
    """Whether all recorders have written something that can be weighed already."""
    try:
        return all(read_bag(folder / f'killed{n}').blocks for n in range(KILLED))
    except BagError:
        return False


def test_a_recording_that_was_killed_weighs_up_to_the_cut(tmp_path: Path):
    moments: list[Callable[[Watcher], bool]] = [
        lambda watcher: watcher.blocks > 200 and have_begun(tmp_path),
        lambda watcher: watcher.judged > 3 and watcher.on_belt,
        lambda watcher: watcher.judged > 6,
    ]

    rate = 3.0
    line = simulated(count=10, lead_in=3.0, run_out=0.5)
    ends = check_killed(line, rate, tmp_path, moments)

    # Of the last second, in which 1.5 times the rate items pass, and of a busy machine's next one.
    assert all(weighed >= judged - 2 * 1.5 * rate for judged, weighed in ends)
    assert ends[0][1] < ends[2][1]


@pytest.mark.soak
def test_recordings_killed_at_many_moments_weigh_up_to_the_cut(tmp_path: Path):
    chance = random.Random(3)
    for number in range(8):
        folder = tmp_path / str(number)
        folder.mkdir()
        moments: list[Callable[[Watcher], bool]] = [
            lambda watcher, folder=folder: watcher.blocks > 200 and have_begun(folder),
            *(after(edges) for edges in sorted(chance.sample(range(1, 60), KILLED - 1))),
        ]
        line = simulated(count=15, spacing=0.4, lead_in=4.0, seed=number)
        ends = check_killed(line, 2.0, folder, moments)
        print(f'\nverdicts at the moment of the kill, and items weighed after it: {ends}')


def after(edges: int) -> Callable[[Watcher], bool]:
    """Return the moment after so many edges: before, in the middle of and after an item."""
    return lambda watcher: watcher.edges >= edges


def test_echo_shows_each_verdict_of_its_lane_and_no_other(bag: Path):
    with (
        started('echo', '--namespace', 'seen', '--count', '5') as seen,
        started('echo', '--namespace', 'other') as other,
    ):
        wait_for_node('/seen/echo', '/other/echo')
        done = run_command('replay', bag, '--rate', RATE, '--namespace', 'seen')
        assert done.returncode == 0, done.stderr
        output, errors = seen.communicate(timeout=60)
        assert seen.returncode == 0, errors
        lines = output.splitlines()
        # From when DDS has brought the two together.
        first = int(lines[1].split()[0])
        assert [int(line.split()[0]) for line in lines[1:6]] == list(range(first, first + 5))
        assert lines[6].startswith('5 items, 5 ACCEPT')
        assert other.stderr is not None
        silence = other.stderr.readline()
        other.send_signal(signal.SIGINT)
        rows_of_other, _ = other.communicate(timeout=60)
    assert rows_of_other == ''
    assert 'nobody publishes /other/load_cell/samples' in silence


def test_passes_of_a_known_mass_are_recorded_with_it(
    bag: Path, rows: Callable[..., list[dict[str, str]]], tmp_path: Path
):
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
        wait_for(
            lambda: (
                set(names)
                <= {
                    f'{space.rstrip("/")}/{own}'
                    for own, space in node.get_node_names_and_namespaces()
                }
            ),
            30.0,
        )
