# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Strangers that publish on a running line: no product is accepted by what they say."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
from graph import play, wait_for
import pytest
from rclpy.node import Node
from running import PATIENCE
from strangers import ATTACKS, FORGED, Attack, Stranger
from supervised_line import SupervisedLine, supervised_line

from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import spinning
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.health.findings import Level
from checkweigher_dsp.nodes.denoise import DenoiseNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.nodes.segmenter import SegmenterNode
from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import StopRequest
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import stamp_from, to_message, to_record

MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)  # kg, of the simulator's products
CLOSE = 0.005  # kg
DURATION = 2.0  # s, of each attack
GOOD = 10  # items weighed after it
# A machine that is busy with other things has the time for a mass.
PATIENT = """
/running/reject:
  ros__parameters:
    rejector_distance: 8.0
"""
TOGETHER = (
    'estimates of items', 'estimates of items, gone at once', 'estimates of items, as identifier',
    'forged load_cell/info',
    'forged stop_request, as reject', 'a second reject that answers for its parameters',
)  # fmt: skip


class Campaign:
    """Attacks on one line, one after the other, each with what became of the line."""

    def __init__(self, line: SupervisedLine) -> None:
        self.line = line
        self.spinner = line.spinner
        self.counts: Counter[str] = Counter()
        self.stamps: set[int] = set()  # of edges, ns
        self.made_up: set[int] = set()  # of those that no eye saw
        self.attacked = 0  # until then, ns of the line: where the host is busy it is behind
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
            self.made_up |= stranger.made_up
            self.spinner.remove(stranger)
        ended = time.monotonic()
        self._take_all()
        self._hear_edges()
        self.attacked = self._hear_edge()  # of the driver: the strangers have gone
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
            assert not wrong, (attacks, [(v.item_id, v.mass, v.late) for v in wrong])
            numbers = Counter(verdict.item_id for verdict in own)
            assert max(numbers.values()) == 1, (attacks, numbers)
        log = self.line.log.read_text(encoding='utf-8')
        assert '; started again after' not in log, (attacks, log)
        self.counts['held'] += len(attacks)

    def _take_all(self) -> None:
        while not self.line.verdicts.empty():
            self.line.found.append(self.line.verdicts.get()[1])

    def _recover(self) -> None:
        """Wait for the second item that is weighed, and demand that those after it are."""
        for _ in range(2):
            while (verdict := self._next()).decision != Verdict.ACCEPT:
                pass
        # The FAULT of one before it comes when that is at the rejector, so it may come later.
        self.attacked = stamp_from(verdict.t1)
        last = [self._next() for _ in range(GOOD)]
        assert {verdict.decision for verdict in last} == {Verdict.ACCEPT}, (
            [list(verdict.reasons) for verdict in last],
            self.line.log.read_text(encoding='utf-8')[-2000:],
        )

    def _next(self) -> Any:
        """Return the next verdict on a product that entered after the attack."""
        while True:
            verdict = self.line.verdicts.get(timeout=PATIENCE)[1]
            self._hear_edges()
            entered = stamp_from(verdict.t1)
            if verdict.item_id < FORGED and entered in self.stamps - self.made_up:
                self.line.found.append(verdict)
                if entered > self.attacked:
                    return verdict

    def _hear_edges(self) -> None:
        while not self.line.edges.empty():
            self._hear_edge()

    def _hear_edge(self) -> int:
        edge = self.line.edges.get(timeout=PATIENCE)[1]
        self.stamps.add(stamp := stamp_from(edge.header.stamp))
        return stamp


def _is_wrong(verdict: Verdict) -> bool:
    off = min(abs(verdict.mass - mass) for mass in MASSES)
    return verdict.decision == Verdict.ACCEPT and off > CLOSE


def _attack(name: str) -> Attack:
    return next(attack for attack in ATTACKS if attack.name == name)


def test_no_product_is_accepted_by_what_a_stranger_says(tmp_path: Path):
    with supervised_line(tmp_path, PATIENT) as line:
        campaign = Campaign(line)
        campaign.run([_attack(name) for name in TOGETHER], DURATION)
        assert campaign.counts['faults'] > 0
        assert line.end() == 130
    print(dict(campaign.counts))


@pytest.mark.soak
@pytest.mark.parametrize('processes', [True, False])
def test_each_kind_of_stranger(tmp_path: Path, processes: bool):
    with supervised_line(tmp_path, PATIENT, processes=processes) as line:
        campaign = Campaign(line)
        for attack in ATTACKS:
            began = time.monotonic()
            campaign.run([attack], DURATION)
            print(f'{attack.name}: {time.monotonic() - began:.0f} s', flush=True)
        assert line.end() == 130
    print(f'\n{len(ATTACKS)} kinds: {dict(campaign.counts)}')


class OwnIdentifier(Node):
    """A user's node in the place of the identifier."""

    def __init__(self) -> None:
        super().__init__('my_identifier')
        self._identifier = Identifier(IdentifierParameters())
        port = ports.MASS_ESTIMATE
        self._estimates = self.create_publisher(port.type, port.name, port.qos)
        port = ports.DENOISED_WINDOW
        self.create_subscription(port.type, port.name, self._on_window, port.stage_qos)

    def _on_window(self, message: Any) -> None:
        estimate = self._identifier.estimate(to_record(ports.DENOISED_WINDOW, message))
        self._estimates.publish(to_message(ports.MASS_ESTIMATE, estimate))


@pytest.mark.parametrize('allowed', ['my_identifier', ''])
def test_a_node_in_the_place_of_a_stage_works_if_it_is_allowed(allowed: str):
    with spinning('own') as spinner:
        listener = ResultListener('listener', from_start=False)
        reject = RejectNode({'deadlines': False, 'allowed_publishers': allowed})
        for node in (SegmenterNode(), DenoiseNode(), OwnIdentifier(), reject, listener):
            spinner.add(node)  # one by one, so that everything goes over DDS
        reasons = {weighing.verdict.reasons for weighing in play(spinner, listener)}
    assert reasons == {() if allowed else ('ForeignPublisher',)}


class StoppedDriver(DriverNode):
    """A driver that shows the requests that it takes and those that it refuses."""

    def __init__(self) -> None:
        self.taken: list[StopRequest | None] = []
        self.refused: list[str] = []
        super().__init__({'autostart': False})

    def _on_stop_request(self, request: StopRequest | None) -> None:
        super()._on_stop_request(request)
        self.taken.append(request)

    def refuse(self, port: ports.Port, error: Exception) -> None:
        super().refuse(port, error)
        self.refused.append(str(error))


def test_leave_to_run_comes_from_reject_alone():
    with spinning('stopped') as spinner:
        driver, reject, stranger = StoppedDriver(), Node('reject'), Node('stranger')
        for node in (driver, reject, stranger):
            spinner.add(node)
        port = ports.STOP_REQUEST
        own = reject.create_publisher(port.type, port.name, port.qos)
        wait_for(own.get_subscription_count)
        stop = StopRequest(StopReason.TOO_MANY_REJECTS, 7)
        own.publish(to_message(port, stop))
        wait_for(lambda: driver.taken == [stop])
        other = stranger.create_publisher(port.type, port.name, port.qos)
        wait_for(other.get_subscription_count)
        other.publish(to_message(port, None))
        wait_for(lambda: bool(driver.refused))
        assert driver.taken == [stop]
        finding = driver.diagnostics.connections.finding(time.monotonic())
        text = 'ForeignPublisher: /stopped/stranger publishes /stopped/stop_request beside reject'
        assert (finding.level, finding.text) == (Level.ERROR, text)
        own.publish(to_message(port, None))
        wait_for(lambda: len(driver.refused) == 2)  # which of the two it comes from is not known
        spinner.remove(stranger)
        wait_for(lambda: driver.taken == [stop, None])


def test_a_node_names_the_strangers_on_what_it_makes():
    with spinning('deceived') as spinner:
        reject, stranger = RejectNode(), Node('stranger')
        spinner.add(reject)
        spinner.add(stranger)
        stranger.create_publisher(ports.VERDICT.type, ports.VERDICT.name, ports.VERDICT.qos)

        def told() -> str:
            return reject.diagnostics.connections.finding(time.monotonic()).text

        text = 'ForeignPublisher: /deceived/stranger publishes /deceived/verdict beside reject'
        wait_for(lambda: told() == text)
