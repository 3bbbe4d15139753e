# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Strangers that publish on a running line: no product is accepted by what they say."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
import time

from checkweigher_msgs.msg import Verdict
from graph import wait_for
import pytest
from strangers import ATTACKS, FORGED, Attack, Stranger
from supervised_line import SupervisedLine, supervised_line

MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)  # kg, of the simulator's products
CLOSE = 0.005  # kg
DURATION = 2.0  # s, of each attack
GOOD = 10  # items weighed after it
TOGETHER = (
    'estimates of items', 'estimates of items, as identifier', 'forged load_cell/info',
    'forged stop_request, as reject', 'a second reject that answers for its parameters',
)  # fmt: skip


class Campaign:
    """Attacks on one line, one after the other, each with what became of the line."""

    def __init__(self, line: SupervisedLine) -> None:
        self.line = line
        self.spinner = line.spinner
        self.counts: Counter[str] = Counter()
        line.judge_until(Verdict.ACCEPT)

    def run(self, attacks: Sequence[Attack], seconds: float) -> None:
        """Make attacks at the same time, and then demand items that are weighed."""
        strangers = [Stranger(attack.node) for attack in attacks]
        for stranger in strangers:
            self.spinner.add(stranger)
        wait_for(lambda: all(each.info and each.edges for each in strangers))
        self.line.found.clear()
        for attack, stranger in zip(attacks, strangers, strict=True):
            self.counts['acts'] += attack.run(stranger, seconds / len(attacks))
        for stranger in strangers:
            self.spinner.remove(stranger)
        ended = time.monotonic()
        self._take_all()
        during, self.line.found = self.line.found, []
        self._recover()
        self.counts['tried'] += len(attacks)
        self.counts['faults'] += sum(v.decision == Verdict.FAULT for v in during)
        self.counts['slowest recovery, s'] = max(
            self.counts['slowest recovery, s'], round(time.monotonic() - ended)
        )
        own = [verdict for verdict in (*during, *self.line.found) if verdict.item_id < FORGED]
        wrong = [verdict for verdict in own if _is_wrong(verdict)]
        if not any('verdict' in attack.name for attack in attacks):
            assert not wrong, (attacks, wrong)
            numbers = Counter(verdict.item_id for verdict in own)
            assert max(numbers.values()) == 1, (attacks, numbers)
        log = self.line.log.read_text(encoding='utf-8')
        assert 'started again' not in log, (attacks, log)
        self.counts['held'] += len(attacks)

    def _take_all(self) -> None:
        while not self.line.verdicts.empty():
            self.line.found.append(self.line.verdicts.get()[1])

    def _recover(self) -> None:
        """Wait for the second item that is weighed, and demand that those after it are."""
        for _ in range(2):
            self.line.judge_until(Verdict.ACCEPT)
        begin = len(self.line.found)
        for _ in range(GOOD):
            self.line.judge_until(Verdict.ACCEPT)
        assert len(self.line.found) == begin + GOOD, self.line.found[begin:]


def _is_wrong(verdict: Verdict) -> bool:
    off = min(abs(verdict.mass - mass) for mass in MASSES)
    return verdict.decision == Verdict.ACCEPT and off > CLOSE


def _attack(name: str) -> Attack:
    return next(attack for attack in ATTACKS if attack.name == name)


def test_no_product_is_accepted_by_what_a_stranger_says(tmp_path: Path):
    with supervised_line(tmp_path) as line:
        campaign = Campaign(line)
        campaign.run([_attack('estimates of items, gone at once')], DURATION)
        assert campaign.counts['faults'] > 0
        campaign.run([_attack(name) for name in TOGETHER], 2 * DURATION)
        assert line.end() == 130
    print(dict(campaign.counts))


@pytest.mark.soak
def test_fifty_kinds_of_strangers(tmp_path: Path):
    with supervised_line(tmp_path) as line:
        campaign = Campaign(line)
        for attack in ATTACKS:
            began = time.monotonic()
            campaign.run([attack], DURATION)
            print(f'{attack.name}: {time.monotonic() - began:.0f} s', flush=True)
        assert line.end() == 130
    print(f'\n{len(ATTACKS)} kinds: {dict(campaign.counts)}')
