# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Graph with a rejector over Modbus TCP."""

from collections.abc import Iterator, Mapping
from pathlib import Path
import queue
import time
from typing import Any

from checkweigher_msgs.msg import StopRequest
from graph import aspect, call
from modbus_machine import BAG, MS, REJECTOR, RELEASE, Plc, outputs_of
import pytest
from running import PATIENCE, wait_for
from std_srvs.srv import Trigger

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_core.health.findings import Level
from checkweigher_core.records import Decision, Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_driver.devices import SOURCES
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.reject import RejectNode

ITEMS = 8


@pytest.fixture
def plc(tmp_path: Path) -> Iterator[Plc]:
    made = Plc(tmp_path)
    made.start()
    yield made
    made.kill()


class Line:
    """Graph with outputs, which plays a bag in real time, and its verdicts and stop requests."""

    def __init__(self, spinner: Spinner, plc: Plc, monkeypatch: Any, **limits: float) -> None:
        # Under a name that the parameter allows.
        monkeypatch.setitem(SOURCES, 'simulator', 'live_bag:LiveBag')
        self._node = PortNode('listener')
        self._heard: queue.SimpleQueue[Verdict] = queue.SimpleQueue()
        self._node.subscribe(ports.VERDICT, self._heard.put)
        self.stops: list[StopRequest] = []
        topic = ports.STOP_REQUEST
        self._node.create_subscription(topic.type, topic.name, self.stops.append, topic.stage_qos)
        spinner.add(self._node)
        self.reject = RejectNode(overrides=limits)
        spinner.add(self.reject)
        for name in ('identifier', 'denoise', 'segmenter'):
            spinner.add(STAGE_NODES[name]())
        source = {'source': 'simulator', 'live.path': str(BAG), 'rejector.verdict_timeout': 5.0}
        self.driver = DriverNode({**source, **outputs_of(plc)})
        spinner.add(self.driver)

    def verdict(self) -> Verdict:
        return self._heard.get(timeout=PATIENCE)

    def verdict_after(self, time: int) -> Verdict:
        """Return the next verdict on a product that left the belt after a time in ns."""
        while (verdict := self.verdict()).t3 is None or verdict.t3 < time:
            pass
        return verdict

    def reset(self) -> bool:
        return bool(call(self._node, Trigger, ports.RESET_STOP_REQUEST).success)


def test_the_line_rejects_over_modbus_and_stops_when_no_node_gives_verdicts(
    plc: Plc, monkeypatch: Any
):
    with spinning('ejecting') as spinner:
        # The rejector is 1.5 s behind the outfeed eye, for a machine that is busy.
        limits = {'lower_limit': 0.12, 'upper_limit': 0.2, 'rejector_distance': 2.25}
        line = Line(spinner, plc, monkeypatch, **limits)
        verdicts = [line.verdict() for _ in range(ITEMS)]
        last = max(due for each in verdicts if (due := each.reject_at) is not None)
        wait_for(lambda: time.time_ns() > last + 150 * MS, 'the last item')
        assert plc.state(RELEASE) is True
        figures = aspect(line.driver, 'Outputs').values
        spinner.remove(line.reject)
        wait_for(lambda: plc.state(RELEASE) is False, 'the stop')
    _check(plc, verdicts, figures)


def _check(plc: Plc, verdicts: list[Verdict], figures: Mapping[str, Any]) -> None:
    # 74.5, 134.5, 164.5, 194.5 and 254.5 g in turn.
    assert ''.join(each.decision.name[0] for each in verdicts) == 'UAAAOUAA'
    dues = [each.reject_at for each in verdicts if each.decision != Decision.ACCEPT]
    # The first one ends the safe state.
    ons = [when for when, on in plc.switches(REJECTOR) if on][1 : 1 + len(dues)]
    late = [when - due for when, due in zip(ons, dues, strict=True)]
    print(f'rejected {[f"{each / MS:.2f}" for each in late]} ms after the reject time; {figures}')
    stated = figures['largest_switch_error_ms'] + figures['switch_uncertainty_ms']
    assert 0 < min(late) <= max(late) <= (stated + 0.5) * MS


def test_a_product_that_the_rejector_missed_stops_the_line_until_the_reset(
    plc: Plc, monkeypatch: Any
):
    with spinning('missing') as spinner:
        # All are rejected, far enough behind the belt for a busy machine.
        line = Line(spinner, plc, monkeypatch, upper_limit=0.01, rejector_distance=1.5)
        line.verdict()
        wait_for(lambda: plc.state(RELEASE) is True, 'the release')
        plc.kill()
        wait_for(lambda: 'cannot be reached' in line.stops[-1].hint, 'the stop request')
        assert line.stops[-1].reason == 'DriverTrouble'
        assert not line.reset()  # they still are not reached
        down = line.verdict()
        wait_for(lambda: time.time_ns() > down.reject_at, 'the reject time')
        plc.start()
        wait_for(lambda: 'behind the rejector' in line.stops[-1].hint, 'the missed product')
        assert line.stops[-1].state == StopRequest.STOP
        assert aspect(line.driver, 'Outputs').level == Level.ERROR
        wait_for(lambda: plc.state(RELEASE) is False, 'the outputs')
        wait_for(lambda: 'cannot be reached' not in line.stops[-1].hint, 'the end of the trouble')
        line.verdict_after(time.time_ns())  # nothing changes by itself
        assert plc.state(RELEASE) is False
        wait_for(line.reset, 'the reset')  # it is refused while a trouble lasts
        wait_for(lambda: plc.state(RELEASE) is True, 'the release after the reset')
        wait_for(lambda: line.stops[-1].state == StopRequest.RUN, 'the end of the request')
        due = line.verdict_after(time.time_ns()).reject_at

        def rejected() -> bool:
            return any(on and when >= due for when, on in plc.switches(REJECTOR))

        wait_for(rejected, 'the next reject')
        assert plc.state(RELEASE) is True


def test_a_bad_output_parameter_is_refused(plc: Plc):
    with spinning('refused'), pytest.raises(ValueError, match='coil 0 is also used'):
        DriverNode({**outputs_of(plc), 'modbus_outputs.stop': 0})
