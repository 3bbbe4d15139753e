"""Recording and listening to a running graph, each in a process of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
import signal
import subprocess
import sys
import time

from lines import simulated
import pytest
from rclpy.node import Node
from running import run_command
import yaml

from checkweigher_bringup.spinning import spinning
from checkweigher_driver.bag_writing import write_bag

MODULE = [sys.executable, '-m', 'checkweigher_bringup.cli']

# A late listener misses what was sent before DDS has brought it together with the line, which can
# take seconds: so long an empty belt comes first. Of it only the last second matters to a mass.
EMPTY_BELT = 20.0  # s
RATE = 4


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag that begins with a long empty belt."""
    line = simulated(count=6, lead_in=EMPTY_BELT)
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


def test_a_recording_weighs_as_the_line_did(
    bag: Path, rows: Callable[..., list[dict[str, str]]], tmp_path: Path
):
    with started('record', '--output', tmp_path / 'bag', '--namespace', 'taped') as recorder:
        replayed = rows('replay', bag, '--rate', RATE, '--namespace', 'taped')
        recorder.send_signal(signal.SIGINT)
        output, errors = recorder.communicate(timeout=20)
    assert recorder.returncode == 0, errors
    assert 'messages' in output
    assert rows('weigh', tmp_path / 'bag') == replayed
    information = yaml.safe_load((tmp_path / 'bag/metadata.yaml').read_text())
    topics = information['rosbag2_bagfile_information']['topics_with_message_count']
    counts = {each['topic_metadata']['name']: each['message_count'] for each in topics}
    assert counts['/taped/verdict'] == 6
    assert counts['/diagnostics'] > 0
    assert {'/taped/statistics', '/taped/zero_setting', '/taped/reject_eye'} <= set(counts)


def unfinished(folder: Path) -> Path:
    """Return the file that a recorder left that could not end."""
    (file,) = folder.glob('.*.partial/*.mcap')
    return file


def test_a_recording_that_was_killed_says_so_and_weighs_up_to_the_cut_once_recovered(
    bag: Path, rows: Callable[..., list[dict[str, str]]], tmp_path: Path
):
    with started('record', '--output', tmp_path / 'bag', '--namespace', 'killed') as recorder:
        replayed = rows('replay', bag, '--rate', RATE, '--namespace', 'killed')
        recorder.kill()
        recorder.communicate(timeout=20)
    assert not (tmp_path / 'bag').exists()
    file = unfinished(tmp_path)
    refused = run_command('weigh', file)
    assert refused.returncode == 2
    assert 'checkweigher recover' in refused.stderr

    recovered = run_command('recover', file, '--output', tmp_path / 'bag')
    assert recovered.returncode == 0, recovered.stderr
    weighed = rows('weigh', tmp_path / 'bag')
    whole = [row for row in weighed if 'StreamEnded' not in row['reasons']]
    assert len(whole) >= len(replayed) - 3  # of the last chunk, a second or two
    expected = replayed[: len(whole)]
    for last in (whole[-1], expected[-1]):
        del last['t4']  # which may lie behind the cut
    assert whole == expected


def test_echo_shows_each_verdict_of_its_lane_and_no_other(bag: Path):
    with (
        started('echo', '--namespace', 'seen', '--count', '5') as seen,
        started('echo', '--namespace', 'other', '--duration', '12') as other,
    ):
        done = run_command('replay', bag, '--rate', RATE, '--namespace', 'seen')
        assert done.returncode == 0, done.stderr
        output, errors = seen.communicate(timeout=30)
        assert seen.returncode == 0, errors
        lines = output.splitlines()
        assert [int(line.split()[0]) for line in lines[1:6]] == [1, 2, 3, 4, 5]
        assert lines[6].startswith('5 items, 5 ACCEPT')
        rows_of_other, silence = other.communicate(timeout=30)
    assert rows_of_other == ''
    assert 'nobody publishes /other/load_cell/samples' in silence


def test_passes_of_a_known_mass_are_recorded_with_it(
    bag: Path, rows: Callable[..., list[dict[str, str]]], tmp_path: Path
):
    with started(
        'record', '--output', tmp_path / 'bag', '--namespace', 'known', '--reference', 150,
        '--passes', 3,
    ) as recorder:  # fmt: skip
        wait_for_node('/known/record')
        replayed = rows('replay', bag, '--rate', RATE, '--namespace', 'known')
        output, errors = recorder.communicate(timeout=20)
    assert recorder.returncode == 0, errors
    assert '3 passes' in output
    assert 'pass 3 of 3' in output + errors
    # What the line itself says of its masses is not in the bag.
    masses = [(row['t1'], row['reference_g']) for row in rows('weigh', tmp_path / 'bag')]
    known = [t1 for t1, reference in masses if reference]
    assert [reference for _, reference in masses if reference] == ['150.000000'] * 3
    times = [row['t1'] for row in replayed]
    assert known == times[times.index(known[0]) :][:3]


def wait_for_node(name: str) -> None:
    with spinning() as spinner:
        node = Node('watcher')
        spinner.add(node)
        end = time.monotonic() + 30
        while name not in {
            f'{space.rstrip("/")}/{own}' for own, space in node.get_node_names_and_namespaces()
        }:
            assert time.monotonic() < end, f'waited in vain for {name}'
            time.sleep(0.02)
