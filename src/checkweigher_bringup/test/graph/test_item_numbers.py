# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""One verdict and one number an item while nodes of the line are killed, each in its process."""

from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from itertools import cycle, islice
import os
from pathlib import Path
import queue
import random
import signal
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
from checkweigher_msgs.srv import LineHistory as LineHistoryService
from graph import wait_for
import pytest
from rclpy.task import Future
from supervised_line import SupervisedLine, supervised_line

from checkweigher_dsp.records import NANOSECONDS, Eye, LineHistory
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import stamp_from, to_record

# Of each campaign, and where its chances begin: CHECKWEIGHER_SHARD tells one from another.
KILLS = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '40'))
SHARD = int(os.environ.get('CHECKWEIGHER_SHARD', '0'))
NODES = ('segmenter', 'driver', 'reject', 'identifier', 'reject', 'driver', 'segmenter')


class Campaign:
    """Kills of nodes of a line, and what the driver and a listener have heard of its items."""

    def __init__(self, line: SupervisedLine) -> None:
        self.line = line
        self.answer = Future()
        self._client = line.listener.create_client(LineHistoryService, ports.LINE_HISTORY.name)
        self.killed: Counter[str] = Counter()
        self.verdicts: dict[tuple[int, int], set[int]] = {}  # by stream and t1
        self.entered: dict[tuple[int, int], None] = {}
        self.numbers: dict[int, set[tuple[int, int]]] = {}
        self.heard: Counter[int] = Counter()
        self.starts: Counter[int | None] = Counter()  # a simulation begins each stream with these

    def kill(self, name: str, *, look: bool = True) -> None:
        """Kill a node that has been started."""
        if look:
            self.look()  # the history of the driver is short, and goes with it
        wait_for(lambda: self._killed(name))
        self.killed[name] += 1

    def _killed(self, name: str) -> bool:
        with suppress(AssertionError, OSError):  # it is yet to be started again
            os.kill(self.line.pid(name), signal.SIGKILL)
            return True
        return False

    def judge_for(self, seconds: float) -> None:
        """Let the line run."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            with suppress(queue.Empty):
                self._hear(self.line.verdicts.get(timeout=left)[1])

    def judge_until(self, decision: int) -> None:
        """Let the line run until a verdict of a decision has come."""
        before = len(self.line.found)
        self.line.judge_until(decision)
        for verdict in self.line.found[before:]:
            self._hear(verdict)

    def _hear(self, verdict: Any) -> None:
        self.heard[verdict.item_id] += 1
        self.starts[stamp_from(verdict.t1)] += 1

    def judge_until_known(self) -> None:
        """Let the line run until an item is weighed, and the driver knows its number."""
        self.judge_until(Verdict.ACCEPT)
        while self.look() < max(self.heard):
            self.judge_for(0.1)

    def look(self) -> int:
        """Take what the driver knows of its stream; return the largest number that it knows."""
        while not self.answer.done():  # DDS may lose one where both ends have hardly met
            self.answer = self._client.call_async(LineHistoryService.Request())
            with suppress(AssertionError):
                wait_for(self.answer.done, timeout=5)
        history: LineHistory = to_record(ports.LINE_HISTORY, self.answer.result())
        self.answer = Future()
        for edge in history.edges:
            if edge.eye is Eye.INFEED and edge.blocked:
                self.entered[history.stream, edge.stamp] = None
        for verdict in history.verdicts:
            if verdict.t1 is not None:
                item = history.stream, verdict.t1
                self.verdicts.setdefault(item, set()).add(verdict.item_id)
                self.numbers.setdefault(verdict.item_id, set()).add(item)
        return history.last_item_id

    def check(self) -> None:
        """Print the counts, and check that each item has one verdict under a number of its own."""
        # What came later is on its way: a mass is waited for until the item is at the rejector.
        last = {stream: t1 - 2 * NANOSECONDS for stream, t1 in sorted(self.verdicts)}
        due = [item for item in self.entered if item[0] in last and item[1] <= last[item[0]]]
        doubled = [item for item, numbers in self.verdicts.items() if len(numbers) > 1]
        twice = [number for number, items in self.numbers.items() if len(items) > 1]
        twice += [number for number, count in self.heard.items() if count > 1]
        # A driver that has hardly begun may miss a verdict that the listener has heard.
        streams = Counter(t1 for _, t1 in due)
        unknown = [item for item in due if item not in self.verdicts]
        lost = [(stream, t1) for stream, t1 in unknown if self.starts[t1] < streams[t1]]
        killed = ', '.join(f'{name} {count}' for name, count in self.killed.items())
        print(
            f'killed {killed}; {len(due)} items, doubled {len(doubled)}, lost {len(lost)}, '
            f'numbers used twice {len(twice)}'
        )
        assert (doubled, lost, twice) == ([], [], [])


@pytest.fixture
def campaign(tmp_path: Path) -> Iterator[Campaign]:
    with supervised_line(tmp_path) as line:
        yield Campaign(line)


@pytest.mark.parametrize('kills', [2, pytest.param(KILLS, marks=pytest.mark.soak)])
def test_each_item_has_one_verdict_and_one_number_over_kills_of_segmenter_and_reject(
    campaign: Campaign, kills: int
):
    chance = random.Random(kills + SHARD)
    campaign.judge_until(Verdict.ACCEPT)
    for number in range(kills):
        if number % 5 == 0:  # from now on it counts from 1 again
            campaign.kill('segmenter')
            campaign.judge_until(Verdict.FAULT)
        if number % 5 == 3:
            campaign.judge_for(chance.uniform(0, 3))
        else:  # hardly has it begun to judge, and the numbers are those of the segmenter
            campaign.judge_until(Verdict.ACCEPT)
        campaign.kill('reject')
    campaign.judge_until(Verdict.ACCEPT)
    campaign.look()
    campaign.check()


@pytest.mark.soak
def test_numbers_go_on_over_kills_of_any_node(campaign: Campaign):
    chance = random.Random(SHARD)
    campaign.judge_until(Verdict.ACCEPT)
    for name in islice(cycle(NODES), SHARD, SHARD + KILLS):
        campaign.kill(name)
        campaign.judge_until_known()
        campaign.judge_for(chance.uniform(0, 2))
    campaign.look()
    campaign.check()


def test_numbers_go_on_where_both_that_know_them_are_killed(campaign: Campaign):
    campaign.judge_until_known()
    campaign.kill('segmenter')  # from now on it counts from 1 again
    campaign.judge_until_known()
    os.kill(campaign.line.pid('driver'), signal.SIGKILL)
    campaign.kill('reject', look=False)
    before = max(campaign.heard)
    campaign.judge_until_known()
    campaign.check()
    assert min(number for number in campaign.heard if number > before) == before + 1
