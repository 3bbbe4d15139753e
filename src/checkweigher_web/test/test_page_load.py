# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Effect of many viewers, many requests and a killed page on the line."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from http.client import HTTPException
from pathlib import Path
import signal
import statistics
import threading
import time

from browsers import needs_browser, open_browser, text_of, until
from node_process import spinning
import pytest
from running import BAGS, PATIENCE, wait_for
from served_page import child_of, get, get_text, line_of, served
from viewers import viewers

from checkweigher_core.records import Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

LANE = ('--namespace', '')  # the page shows this lane even before it runs
SHORT, MANY = 4, 20  # numbers of viewers
AMID = 10  # number of verdicts until the page is killed
PAUSE = 0.2  # time between two requests in s
MEASURED = 20.0  # duration of a measurement in s


def take_verdicts(spinner: Spinner, take: Callable[[Verdict], object]) -> None:
    node = PortNode('judged')
    node.subscribe(ports.VERDICT, take)
    spinner.add(node)


@contextmanager
def flooded(port: int) -> Iterator[None]:
    """Request the page repeatedly, so that the server makes all views each time."""
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


@pytest.mark.parametrize(
    ('bag', 'count'),
    [
        ('paper_90', SHORT),
        *(pytest.param(f'paper_{n}', MANY, marks=pytest.mark.soak) for n in (30, 60, 90)),
    ],
)
def test_a_page_that_is_flooded_and_then_killed_costs_the_line_nothing(
    rows: Callable[..., list[dict[str, str]]], bag: str, count: int
):
    with served(*LANE) as (process, port), spinning() as spinner:
        wait_for(lambda: '"board"' in get_text(port))
        judged = set[int]()

        def judge(verdict: Verdict) -> None:
            judged.add(verdict.item_id)
            if len(judged) == AMID:
                process.kill()

        take_verdicts(spinner, judge)
        with viewers(port, count), flooded(port):
            assert process.poll() is None
            replayed = rows('replay', BAGS / bag, '--rate', 4)
        assert process.wait(PATIENCE) == -signal.SIGKILL
    assert replayed == rows('weigh', BAGS / bag)


def processor_time(process: int) -> float:
    """Return the processor time of a process in s, without its children."""
    fields = Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / 100


# Script that stores the time in ms at which the browser first shows each item.
NOTE_ITEMS = """
window.seen = {};
new MutationObserver(() => {
  const found = /item (\\d+),/.exec(document.querySelector("[aria-label=Item] .about").innerText);
  if (found) window.seen[found[1]] ??= Date.now();
}).observe(document.querySelector("[aria-label=Item]"),
           {subtree: true, childList: true, characterData: true});
"""


class Clock:
    """Times in s of the verdicts on the monotonic clock.

    `apart` is the time in s by which the system clock, which browsers use, is ahead of this clock.
    """

    def __init__(self) -> None:
        self.judged: dict[int, float] = {}
        self.apart = time.time() - time.monotonic()

    def judge(self, verdict: Verdict) -> None:
        self.judged.setdefault(verdict.item_id, time.monotonic())

    def delays(self, seen: Mapping[int, float], begin: float) -> list[float]:
        common = seen.keys() & self.judged.keys()
        return [seen[item] - self.judged[item] for item in common if self.judged[item] > begin]


@contextmanager
def judged_line(folder: Path, clock: Clock) -> Iterator[int]:
    """Run an endless line whose verdicts `clock` receives, and yield its process identifier."""
    values = {'driver': {'simulator': {'count': 0, 'seed': 3}}}
    with line_of(folder / 'line.yaml', values) as line, spinning() as spinner:
        take_verdicts(spinner, clock.judge)
        wait_for(lambda: clock.judged)
        yield child_of(line.pid)


def said_of(name: str, delays: Sequence[float]) -> str:
    worst = statistics.quantiles(delays, n=100)[-1]
    return (
        f'; verdict to {name}: median {statistics.median(delays):.3f} s, 99 % within '
        f'{worst:.3f} s of {len(delays)}'
    )


@pytest.mark.soak
def test_processor_and_delay_of_the_page(tmp_path: Path):
    """Measure a line with 0, 1 and 20 viewers, which are sockets without browsers."""
    clock = Clock()
    with judged_line(tmp_path, clock) as line, served(*LANE) as (page, port):
        for count in (0, 1, MANY):
            with viewers(port, count) as looking:
                wait_for(lambda looking=looking: all(each.seen for each in looking))
                begin = time.monotonic()
                before = [processor_time(each) for each in (line, page.pid)]
                time.sleep(MEASURED)
                after = [processor_time(each) for each in (line, page.pid)]
                taken = time.monotonic() - begin
            shares = [(b - a) / taken for a, b in zip(before, after, strict=True)]
            text = f'{count} viewers: line {shares[0]:.1%}, page {shares[1]:.1%} of a core'
            if delays := [d for each in looking for d in clock.delays(each.seen, begin)]:
                text += said_of('viewer', delays)
                assert statistics.median(delays) < 0.3
            print(text)


@pytest.mark.soak
@needs_browser
def test_delay_in_a_browser_beside_other_viewers(tmp_path: Path):
    """Measure the delay of items in a real browser, alone and with 20 other viewers."""
    clock = Clock()
    with (
        judged_line(tmp_path, clock),
        served(*LANE) as (_, port),
        open_browser(tmp_path / 'browser') as browser,
    ):
        for count in (0, MANY):
            with viewers(port, count):
                browser.get(f'http://127.0.0.1:{port}/')
                until(browser, lambda: 'item ' in text_of(browser, '[aria-label=Item] .about'))
                browser.execute_script(NOTE_ITEMS)
                begin = time.monotonic()
                time.sleep(MEASURED)
                seen = browser.execute_script('return window.seen')
            found = {int(item): at / 1000 - clock.apart for item, at in seen.items()}
            delays = clock.delays(found, begin)
            print(f'beside {count} viewers' + said_of('a browser', delays))
            assert statistics.median(delays) < 0.3
