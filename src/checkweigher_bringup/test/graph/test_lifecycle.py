# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Managed nodes `driver` and `reject` over real DDS, which are safe when inactive."""

import queue
import signal
import subprocess
import sys
from typing import Any

from checkweigher_msgs.msg import StopRequest, StreamStatus, Verdict
from graph import call, heard, wait_for
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
import pytest
from rclpy.node import Node
from reject_line import RejectLine, estimate
from running import PATIENCE
from verdicts import assert_one_verdict_each

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import stamp_from
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.reject import RejectNode

LANE = 'rejecting'

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
# Three products a second, to be judged half a second after they have left the belt.
FAST = {'simulator.count': 0, 'simulator.spacing': 0.4, 'simulator.lead_in': 0.5, 'lossless': False}


class Manager:
    """Lifecycle manager of one node."""

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name = node, name

    def change(self, transition: int) -> bool:
        """Request a transition, and return whether it was made."""
        wanted = Transition(id=transition)
        name = f'{self._name}/change_state'
        return bool(call(self._node, ChangeState, name, transition=wanted).success)

    def state(self) -> str:
        """Return the name of the state."""
        return str(call(self._node, GetState, f'{self._name}/get_state').current_state.label)


@pytest.fixture
def node(spinner: Spinner) -> Node:
    made = Node('manager')
    spinner.add(made)
    return made


def next_of(messages: 'queue.SimpleQueue[Any]') -> Any:
    return messages.get(timeout=PATIENCE)[1]


def test_a_reject_node_that_is_not_active_stops_the_line_and_judges_nothing(spinner: Spinner):
    line = RejectLine(spinner, autostart=False, rejector_distance=0.1)
    manager = Manager(line.node, 'reject')
    request = line.stop()
    assert (request.state, request.reason) == (StopRequest.STOP, 'NotReady')
    assert request.hint
    line.pass_item(1)
    assert manager.change(CONFIGURE)
    assert line.stops.empty()

    assert manager.change(ACTIVATE)

    assert line.stop().state == StopRequest.RUN
    line.pass_item(2)
    found = [line.verdict(), line.verdict()]  # the first one, which nobody judged, is a fault now
    assert [stamp_from(each.t1) for each in found] == [estimate(n, 0.1).t1 for n in (1, 2)]
    assert [each.decision for each in found] == [Verdict.FAULT] * 2


def test_deactivating_reject_gives_what_is_on_its_way_a_fault(spinner: Spinner):
    line = RejectLine(spinner, rejector_distance=100.0)
    manager = Manager(line.node, 'reject')
    assert line.stop().state == StopRequest.RUN
    line.pass_item(1)
    line.pass_item(2)
    line.wait_for_count('items received', 2)

    assert manager.change(DEACTIVATE)

    assert [list(line.verdict().reasons), list(line.verdict().reasons)] == [['NoEstimate']] * 2
    assert line.stop().reason == 'NotReady'
    assert manager.change(ACTIVATE)
    assert line.stop().state == StopRequest.RUN


def test_a_transition_that_the_state_lacks_is_refused_and_the_node_lives(
    spinner: Spinner, node: Node
):
    spinner.add(RejectNode({'autostart': False}))
    manager = Manager(node, 'reject')
    assert not manager.change(ACTIVATE)
    assert not manager.change(99)
    assert manager.state() == 'unconfigured'
    assert manager.change(CONFIGURE)
    assert not manager.change(CONFIGURE)
    assert manager.state() == 'inactive'
    assert manager.change(CLEANUP)
    assert spinner.alive


def test_a_source_that_cannot_be_opened_leaves_the_driver_unconfigured_or_ends_it(
    spinner: Spinner, node: Node
):
    driver = DriverNode({'source': 'bag', 'bag.path': '/nowhere', 'autostart': False})
    spinner.add(driver)
    manager = Manager(node, 'driver')
    assert not manager.change(CONFIGURE)
    assert manager.state() == 'unconfigured'
    spinner.remove(driver)
    with pytest.raises(ParameterError, match='there is no such'):
        DriverNode({'source': 'bag', 'bag.path': '/nowhere'})


def test_each_activation_of_the_driver_is_a_stream_that_has_its_end(spinner: Spinner, node: Node):
    status = heard(node, ports.DRIVER_STATUS, latched=True)
    spinner.add(DriverNode({**FAST, 'autostart': False}))
    manager = Manager(node, 'driver')
    assert manager.change(CONFIGURE)
    streams = []
    for _ in range(2):
        assert manager.change(ACTIVATE)
        running = next_of(status)
        assert running.state == StreamStatus.RUNNING
        assert manager.change(DEACTIVATE)
        while (finished := next_of(status)).state == StreamStatus.RUNNING:
            assert finished.stream == running.stream  # said again
        assert finished.state == StreamStatus.FINISHED
        assert running.stream == finished.stream
        streams.append(running.stream)
    assert streams[0] != streams[1]
    assert manager.change(CLEANUP)


def test_a_stream_is_announced_more_than_once(spinner: Spinner, node: Node):
    # Who finds the writer of the first word late would have it from DDS only after seconds.
    status = heard(node, ports.DRIVER_STATUS)
    spinner.add(DriverNode(FAST))
    said = [next_of(status) for _ in range(3)]
    assert {message.state for message in said} == {StreamStatus.RUNNING}
    assert len({message.stream for message in said}) == 1


def test_a_stream_begins_when_reject_is_active(spinner: Spinner, node: Node):
    samples = heard(node, ports.LOAD_CELL_SAMPLES)
    for name, make in STAGE_NODES.items():
        spinner.add(make({'autostart': False} if name == 'reject' else None))
    driver = DriverNode({'simulator.count': 0})
    spinner.add(driver)
    manager = Manager(node, 'reject')
    assert manager.change(CONFIGURE)
    wait_for(driver.stream.has_listeners)
    assert samples.empty()
    assert manager.change(ACTIVATE)
    assert next_of(samples).first_index == 0


def start_reject() -> 'subprocess.Popen[bytes]':
    command = [sys.executable, '-m', 'checkweigher_dsp.nodes.reject', '--ros-args']
    return subprocess.Popen([*command, '-r', f'__ns:=/{LANE}', '-p', 'rejector_distance:=1.0'])


def judge_until(verdicts: 'queue.SimpleQueue[Any]', found: list[Verdict], decision: int) -> None:
    for _ in range(100):
        found.append(next_of(verdicts))
        if found[-1].decision == decision:
            return
    raise AssertionError(f'no decision {decision} among 100 verdicts')


def drain(messages: 'queue.SimpleQueue[Any]') -> None:
    while not messages.empty():
        messages.get()


def test_a_killed_reject_node_leaves_no_item_without_its_verdict(spinner: Spinner, node: Node):
    verdicts = heard(node, ports.VERDICT, latched=True)
    edges = heard(node, ports.PHOTO_EYES)
    stops = heard(node, ports.STOP_REQUEST, latched=True)
    estimates = heard(node, ports.MASS_ESTIMATE)
    spinner.add(*(STAGE_NODES[name]() for name in ('segmenter', 'denoise', 'identifier')))
    reject = start_reject()
    found: list[Verdict] = []
    try:
        spinner.add(DriverNode({**FAST, 'lossless': True}))
        judge_until(verdicts, found, Verdict.ACCEPT)
        said = [next_of(stops)]
        reject.send_signal(signal.SIGKILL)
        reject.wait()
        drain(estimates)
        next_of(estimates)  # which no reject node gets: a fast machine starts one between two items
        reject = start_reject()
        judge_until(verdicts, found, Verdict.FAULT)
        judge_until(verdicts, found, Verdict.ACCEPT)
        judge_until(verdicts, found, Verdict.ACCEPT)
        said.append(next_of(stops))
    finally:
        reject.terminate()
        reject.wait(timeout=PATIENCE)
    said.append(next_of(stops))
    assert [each.state for each in said] == [StopRequest.RUN, StopRequest.RUN, StopRequest.STOP]
    assert said[-1].reason == 'NotReady'
    while not verdicts.empty():  # those on their way when it ended
        found.append(next_of(verdicts))
    assert_one_verdict_each(edges, found)
    for verdict in found:
        assert list(verdict.reasons) == ([] if verdict.decision else ['NoEstimate'])


def test_a_reject_node_that_was_inactive_makes_up_for_it(spinner: Spinner, node: Node):
    verdicts, edges = heard(node, ports.VERDICT), heard(node, ports.PHOTO_EYES)
    estimates = heard(node, ports.MASS_ESTIMATE)
    spinner.add(*(make() for make in STAGE_NODES.values()))
    manager = Manager(node, 'reject')
    spinner.add(DriverNode(FAST | {'lossless': True}))
    found: list[Verdict] = []
    judge_until(verdicts, found, Verdict.ACCEPT)
    assert manager.change(DEACTIVATE)
    drain(estimates)
    next_of(estimates)  # possibly on its way before
    # Items whose mass has come while nobody judged; it will not come a second time.
    missed = {next_of(estimates).item_id for _ in range(3)}
    assert manager.change(ACTIVATE)
    judge_until(verdicts, found, Verdict.FAULT)
    judge_until(verdicts, found, Verdict.ACCEPT)
    assert_one_verdict_each(edges, found)
    assert missed <= {each.item_id for each in found if each.decision == Verdict.FAULT}
