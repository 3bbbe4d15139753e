# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many viewers, a flood of requests and a page that dies: what they cost the line."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.client import HTTPException
from pathlib import Path
import signal
import statistics
import subprocess
import sys
import threading
import time

import pytest
import rclpy
from running import BAGS, PATIENCE
from served_page import get, get_text, served
from viewers import viewers
import yaml

from checkweigher_dsp.records import Verdict
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.port_node import PortNode
from checkweigher_dsp.ros.spinner import Spinner

LANE = ('--namespace', '')  # the page of one lane, also before that runs
SHORT, MANY = 4, 20  # viewers
AMID = 10  # verdicts
PAUSE = 0.2  # s between two requests of a flood
MEASURED = 20.0  # s


def wait_for(condition: Callable[[], object]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@contextmanager
def listening() -> Iterator[Spinner]:
    """Have ROS in this process."""
    rclpy.init()
    spinner = Spinner()
    try:
        yield spinner
    finally:
        spinner.stop()
        rclpy.try_shutdown()


@contextmanager
def flooded(port: int) -> Iterator[None]:
    """Ask for the page over and over: each time the server makes all its views."""
    ended = threading.Event()

    def ask() -> None:
        while not ended.is_set():
            with suppress(OSError, HTTPException):
                get(port)
            ended.wait(PAUSE)

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def check_that_it_costs_nothing(
    rows: Callable[..., list[dict[str, str]]], bag: str, count: int
) -> None:
    """Replay a bag beside a page that is flooded, and is killed at a verdict amid the replay."""
    with served(*LANE) as (process, port), listening() as spinner:
        wait_for(lambda: '"board"' in get_text(port))
        node, judged = PortNode('judged'), set[int]()

        def judge(verdict: Verdict) -> None:
            judged.add(verdict.item_id)
            if len(judged) == AMID:
                process.kill()

        node.subscribe(ports.VERDICT, judge)
        spinner.add(node)
        with viewers(port, count), flooded(port):
            assert process.poll() is None
            replayed = rows('replay', BAGS / bag, '--rate', 4)
        assert process.wait(PATIENCE) == -signal.SIGKILL
    assert replayed == rows('weigh', BAGS / bag)


def test_a_page_that_is_flooded_and_then_killed_costs_the_line_nothing(
    rows: Callable[..., list[dict[str, str]]],
):
    check_that_it_costs_nothing(rows, 'paper_90', SHORT)


@pytest.mark.soak
def test_twenty_viewers_and_a_flood_cost_the_line_nothing(
    rows: Callable[..., list[dict[str, str]]],
):
    for bag in ('paper_30', 'paper_60', 'paper_90'):
        check_that_it_costs_nothing(rows, bag, MANY)


def processor_time(process: int) -> float:
    """Return the processor time of a process, s; that of its children is theirs."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / 100


@pytest.mark.soak
def test_processor_and_delay_of_the_page(tmp_path: Path):
    """Measure an endless line with 0, 1 and 20 viewers."""
    parameters = tmp_path / 'line.yaml'
    values = {'simulator': {'count': 0, 'seed': 3}}
    parameters.write_text(yaml.safe_dump({'/**/driver': {'ros__parameters': values}}))
    words = [sys.executable, '-m', 'checkweigher_bringup.cli', 'run', '--params', str(parameters)]
    line = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    judged: dict[int, float] = {}
    try:
        with served(*LANE) as (page, port), listening() as spinner:
            node = PortNode('judged')
            node.subscribe(
                ports.VERDICT, lambda verdict: judged.setdefault(verdict.item_id, time.monotonic())
            )
            spinner.add(node)
            wait_for(lambda: judged)
            started = Path(f'/proc/{line.pid}/task').glob('*/children')
            (of_line,) = [int(each) for path in started for each in path.read_text().split()]
            for count in (0, 1, MANY):
                with viewers(port, count) as looking:
                    wait_for(lambda looking=looking: all(each.seen for each in looking))
                    begin = time.monotonic()
                    before = [processor_time(each) for each in (of_line, page.pid)]
                    time.sleep(MEASURED)
                    after = [processor_time(each) for each in (of_line, page.pid)]
                    taken = time.monotonic() - begin
                shares = [(b - a) / taken for a, b in zip(before, after, strict=True)]
                text = f'{count} viewers: line {shares[0]:.1%}, page {shares[1]:.1%} of a core'
                delays = [
                    each.seen[item] - judged[item]
                    for each in looking
                    for item in each.seen.keys() & judged.keys()
                    if judged[item] > begin
                ]
                if delays:
                    worst = statistics.quantiles(delays, n=100)[-1]
                    text += f'; verdict to viewer: median {statistics.median(delays):.3f} s'
                    text += f', 99 % within {worst:.3f} s of {len(delays)}'
                    assert count > 1 or statistics.median(delays) < 0.3
                print(text)
    finally:
        line.terminate()
        line.wait()
