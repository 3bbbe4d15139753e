# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Output of the verdicts, with statistics."""

from collections.abc import Callable
import time
from typing import Any

from checkweigher_core.health.findings import Finding
from checkweigher_core.records import Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.health.items import VerdictTiming
from checkweigher_dsp.nodes.given_numbers import GivenNumbers
from checkweigher_dsp.rejection.items import PendingItems


class VerdictOutput:
    """Output of the verdicts, with counters, log messages and findings.

    The numbers of items with a verdict are stored in the file `numbers`. The file also contains the
    numbers of ``items.passed_over``, whose items received their verdict under another number. The
    function `sent` is called with each verdict after its publication.
    """

    def __init__(
        self,
        node: StageNode[Any],
        numbers: GivenNumbers,
        items: PendingItems,
        sent: Callable[[Verdict], None],
    ) -> None:
        self._node, self._numbers, self._items, self._sent = node, numbers, items, sent
        self.output = node.held_output(ports.VERDICT, before=self._store_number)
        self._watch = VerdictTiming()

    def add_edge(self, stamp: int) -> None:
        """Add an outfeed edge that has just arrived; its stamp is in ns."""
        self._watch.add_edge(time.monotonic(), stamp)

    def send(self, verdicts: list[Verdict]) -> None:
        """Publish verdicts, and store the numbers of the items that were passed over."""
        passed_over, self._items.passed_over = self._items.passed_over, []
        for number in passed_over:
            self._numbers.give(number)
        for verdict in verdicts:
            self._send(verdict)

    def _send(self, verdict: Verdict) -> None:
        node, item = self._node, f'item {verdict.item_id}'
        # Do other work after the publication, because the rejector waits for the verdict.
        self.output.send(verdict)
        self._watch.add(time.monotonic(), verdict)
        node.count(verdict.decision.name)
        if not verdict.estimate_id:
            node.count(Reason.NO_ESTIMATE)
            node.warn(f'{item}: NoEstimate: {Reason.NO_ESTIMATE.hint}')
        if verdict.late:
            node.count('late verdicts')
            node.warn(f'{item}: its verdict came after its reject time')
        self._sent(verdict)

    def _store_number(self, verdict: Verdict) -> None:
        # Store the number immediately before the publication, because the process may be killed. If
        # the number were stored after the publication, the item might get two verdicts. If the
        # number were stored while the output holds the verdict, the item might get no verdict.
        self._numbers.give(verdict.item_id)

    def findings(self, now: float) -> list[Finding]:
        """Return the findings on the timing of the verdicts and on missing masses."""
        node = self._node
        no_masses = node.diagnostics.connections.lacks_input(ports.MASS_ESTIMATE)
        margin, deadlines = node.parameters.verdict_margin, node.parameters.deadlines
        return [
            self._watch.verdicts(now, margin, deadlines=deadlines),
            self._watch.line(now, 'identifier' if no_masses else ''),
        ]
