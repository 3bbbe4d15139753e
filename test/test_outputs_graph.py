"""The whole graph with its rejector over Modbus TCP."""

from pathlib import Path
import queue
import time
from typing import Any

from checkweigher_msgs.msg import Verdict as VerdictMessage
from modbus_machine import BAG, MS, REJECTOR, RELEASE, Plc, wait_for
import pytest
from rclpy.node import Node

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import spinning
from checkweigher_driver.driver_node import DriverNode
from checkweigher_driver.sources import SOURCES
from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import verdict_from
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.records import Decision, Verdict

ITEMS = 8


def outputs_of(plc: Plc) -> dict[str, object]:
    return {
        'outputs': 'modbus',
        'modbus_outputs.host': '127.0.0.1',
        'modbus_outputs.port': plc.port,
        'modbus_outputs.stop': RELEASE,
        'modbus_outputs.watchdog': 0,
        # However busy the machine is on which the test runs.
        'modbus_outputs.timeout': 2.0,
        'rejector.late_tolerance': 2.0,
    }


def test_the_line_rejects_over_modbus_and_stops_when_nobody_gives_verdicts(
    tmp_path: Path, monkeypatch: Any
):
    # Under a name that the parameter allows.
    monkeypatch.setitem(SOURCES, 'simulator', 'live_bag:LiveBag')
    plc = Plc(tmp_path)
    plc.start()
    try:
        with spinning('ejecting') as spinner:
            listener = Node('listener')
            heard: queue.SimpleQueue[VerdictMessage] = queue.SimpleQueue()
            listener.create_subscription(
                topics.VERDICT.type, topics.VERDICT.name, heard.put, topics.VERDICT.stage_qos
            )
            spinner.add(listener)
            # 1.5 s behind the outfeed eye, for a machine that is busy with something else.
            reject = RejectNode(
                {'lower_limit': 0.12, 'upper_limit': 0.2, 'rejector_distance': 2.25}
            )
            spinner.add(reject)
            for name in ('identifier', 'denoise', 'segmenter'):
                spinner.add(STAGE_NODES[name]())
            source = {'source': 'simulator', 'live.path': str(BAG)}
            driver = DriverNode({**source, **outputs_of(plc)})
            spinner.add(driver)
            verdicts = [verdict_from(heard.get(timeout=30)) for _ in range(ITEMS)]
            last = max(due for each in verdicts if (due := each.reject_at) is not None)
            wait_for(lambda: time.time_ns() > last + 150 * MS, 'the last item')
            assert plc.state(RELEASE) is True
            outputs = driver._outputs
            assert outputs is not None
            figures = outputs.figures()
            spinner.remove(reject)
            wait_for(lambda: plc.state(RELEASE) is False, 'the stop')
    finally:
        plc.kill()
    _check(plc, verdicts, figures)


def _check(plc: Plc, verdicts: list[Verdict], figures: dict[str, float]) -> None:
    # 74.5, 134.5, 164.5, 194.5 and 254.5 g in turn.
    assert [each.decision for each in verdicts] == [
        Decision.UNDER, Decision.ACCEPT, Decision.ACCEPT, Decision.ACCEPT, Decision.OVER,
        Decision.UNDER, Decision.ACCEPT, Decision.ACCEPT,
    ]  # fmt: skip
    dues = [each.reject_at for each in verdicts if each.decision != Decision.ACCEPT]
    # The first one ends the safe state.
    ons = [when for when, on in plc.switches(REJECTOR) if on][1 : 1 + len(dues)]
    late = [when - due for when, due in zip(ons, dues, strict=True)]
    print(f'rejected {[f"{each / MS:.2f}" for each in late]} ms after the reject time; {figures}')
    stated = figures['largest switch error ms'] + figures['switch uncertainty ms']
    assert 0 < min(late) <= max(late) <= (stated + 0.5) * MS


def test_a_bad_output_parameter_is_refused(tmp_path: Path):
    plc = Plc(tmp_path)
    with spinning('refused'), pytest.raises(ValueError, match='coil 0 is the rejector as well'):
        DriverNode({**outputs_of(plc), 'modbus_outputs.stop': 0})
