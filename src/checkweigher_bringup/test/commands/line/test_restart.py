# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Line of `run --folder`, which keeps product, batch, counts and limits when it is killed."""

from contextlib import suppress
import os
from pathlib import Path
import queue
import random
import signal
import time
from typing import Any

from checkweigher_msgs.srv import NewBatch, SelectProduct
from graph import call, heard, wait_for
from processes import pids_of
import pytest
from running import PATIENCE
from std_srvs.srv import Trigger
from supervised_line import SupervisedLine, supervised_line

from checkweigher_core.ros import ports
from checkweigher_dsp.rejection.parameters import limits_of

# Of the simulated 74.5, 134.5, 164.5, 194.5 and 254.5 g the second is between TU2 and TU1 of tins.
RECIPES = """
products:
  tins: {nominal: 0.141, tu1_quota: 0.025, upper_limit: 0.18}
  bars: {nominal: 0.2, lower_limit: 0.19, upper_limit: 0.21, parameters: {denoise: {stretch: 2048}}}
"""


class Operator:
    """Operator who selects products and begins batches, and knows the expected state."""

    def __init__(self, line: SupervisedLine) -> None:
        self._line = line
        self._products = heard(line.listener, ports.PRODUCT_IN_USE, latched=True)
        self._batches = 0
        self._tally: dict[tuple[str, str], Any] = {}
        self.known: Any = None  # product in use
        self.rejected = self.accepted = 0

    def select(self, product: str) -> None:
        """Select a product, and wait until items are judged by it."""
        self._ask(
            SelectProduct, 'select_product', lambda new: new.product == product, product=product
        )

    def new_batch(self) -> None:
        """Begin another batch, and wait until items are counted for it."""
        self._batches += 1
        name = f'B{self._batches}'
        self._ask(NewBatch, 'new_batch', lambda new: new.batch == name, batch=name)

    def _ask(self, kind: Any, service: str, wanted: Any, **request: str) -> None:
        """Call a service until it has its effect, because a killed line accepts no call."""
        client = self._line.listener.create_client(kind, service)
        wait_for(client.service_is_ready)
        for _ in range(20):
            client.call_async(kind.Request(**request))
            with suppress(queue.Empty):
                return self.await_product(wanted, patience=3)
        raise AssertionError(self._line.log.read_text())

    def await_product(self, wanted: Any, patience: float = PATIENCE) -> None:
        """Wait until the product in use is as wanted."""
        while not wanted(found := self._products.get(timeout=patience)[1]):
            pass
        self.known = found

    def kill(self) -> None:
        """Kill the line, and compare product, batch and limits after its start."""
        self.check_verdicts()
        before = self.known
        killed = self._line.pid('line')
        os.kill(killed, signal.SIGKILL)
        time.sleep(0.5)  # half of the time to the next start: what was under way has come
        assert pids_of(self._line.command.pid, 'line') in ([], [killed])
        with suppress(queue.Empty):  # messages of the killed line
            while True:
                self._products.get_nowait()
        self.await_product(lambda new: new.product)
        assert (self.known.product, self.known.batch) == (before.product, before.batch)
        assert limits_of(self.known) == limits_of(before)

    def kills_in_alarms(self) -> int:
        """Acknowledge all alarms, and return how often the line ended without a stop."""
        alarms = heard(self._line.listener, ports.ALARMS, latched=True)
        (_, first) = alarms.get(timeout=PATIENCE)
        call(self._line.listener, Trigger, ports.ACKNOWLEDGE_ALARMS)
        while any(not each.active for each in alarms.get(timeout=PATIENCE)[1].alarms):
            pass
        return sum(each.count for each in first.alarms if each.reason == 'product')

    def check_verdicts(self) -> None:
        """Check that accepted items are within the limits, and that the counts continue."""
        with suppress(queue.Empty):
            while True:
                self._check(self._line.verdicts.get_nowait()[1])

    def await_accepted(self) -> None:
        """Wait until an item is accepted."""
        before = self.accepted
        while self.accepted == before:
            self._check(self._line.verdicts.get(timeout=PATIENCE)[1])

    def _check(self, verdict: Any) -> None:
        if verdict.decision != verdict.ACCEPT:
            self.rejected += 1
            return
        self.accepted += 1
        low, high = {'tins': (0.128, 0.18), 'bars': (0.19, 0.21)}[verdict.product]
        assert low <= verdict.mass <= high
        key = verdict.product, verdict.batch
        if (last := self._tally.get(key)) is not None:
            # The last verdict before a kill may be on its way to the disk.
            assert verdict.batch_items >= last.batch_items
            assert verdict.batch_accepted >= last.batch_accepted
            assert verdict.batch_below_tu1 >= last.batch_below_tu1
        self._tally[key] = verdict
        if verdict.mass < 0.1346:
            assert verdict.batch_below_tu1 <= 0.025 * verdict.batch_accepted


@pytest.mark.parametrize('rounds', [1, pytest.param(300, marks=pytest.mark.soak)])
def test_a_line_that_is_killed_goes_on_with_product_batch_counts_and_limits(
    tmp_path: Path, rounds: int
):
    draw, machine = random.Random(rounds), tmp_path / 'machine'
    machine.mkdir()
    (machine / 'recipes.yaml').write_text(RECIPES, encoding='utf-8')
    with supervised_line(tmp_path, processes=False, machine=machine) as line:
        operator = Operator(line)
        operator.select('tins')
        operator.new_batch()
        for number in range(rounds):
            time.sleep(draw.uniform(0, 2))
            if number % 2:
                operator.await_accepted()
            operator.kill()
            if number % 3 == 1:
                operator.new_batch()
            elif number % 3 == 2:
                operator.select(draw.choice(['tins', 'bars']))
        operator.await_accepted()
        assert operator.kills_in_alarms() == rounds
        assert line.end() == 130
    print(f'{rounds} kills, {operator.accepted} accepted, {operator.rejected} rejected')
