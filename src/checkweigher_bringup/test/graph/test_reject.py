# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node `reject` over real DDS: late and missing masses and edges, and stops of the line."""

import signal
import subprocess
import time

from checkweigher_msgs.msg import StopRequest, Verdict
from graph import heard, publish, wait_for
from reject_line import START, RejectLine, edges
from running import PATIENCE

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import Spinner, node_command
from checkweigher_core.records import (
    NANOSECONDS,
    Eye,
    EyeEdge,
    StreamState,
    StreamStatus,
    ZeroChange,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import stamp_from, to_message
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.reject import RejectNode

LANE = 'rejecting'
# An item without a mass is a FAULT 2 s after t3 and 2 s before it is at the rejector. Both are for
# a machine that is busy with something else.
IN_TIME = {'rejector_distance': 4.0, 'verdict_margin': 2.0}


def test_a_killed_identifier_costs_its_items_and_no_more(spinner: Spinner):
    listener = ResultListener('listener')
    eyes, verdicts = heard(listener, ports.PHOTO_EYES), heard(listener, ports.VERDICT)
    reject = RejectNode(IN_TIME)
    for node in (listener, STAGE_NODES['segmenter'](), STAGE_NODES['denoise'](), reject):
        spinner.add(node)
    command = node_command(ports.NODES['identifier'], LANE)
    identifier = subprocess.Popen(command)
    try:
        spinner.add(DriverNode({'simulator.count': 0}))

        def judged(decision: int) -> tuple[int, Verdict]:
            while True:
                came, verdict = verdicts.get(timeout=PATIENCE)
                if verdict.decision == decision:
                    return came, verdict

        judged(Verdict.ACCEPT)
        identifier.send_signal(signal.SIGKILL)
        identifier.wait()
        faults = [judged(Verdict.FAULT) for _ in range(2)]
        identifier = subprocess.Popen(command)
        _, weighed = judged(Verdict.ACCEPT)
    finally:
        identifier.kill()
        identifier.wait()
    seen = {}
    while not eyes.empty():
        came, edge = eyes.get()
        seen[stamp_from(edge.header.stamp)] = came
    for came, verdict in faults:
        assert (list(verdict.reasons), verdict.late) == (['NoEstimate'], False)
        t3 = stamp_from(verdict.header.stamp)
        assert came < seen[t3] + stamp_from(verdict.reject_at) - t3
    assert weighed.item_id > faults[-1][1].item_id
    # A listener hears of items that were not weighed as well.
    shown = []
    while not listener.weighings.empty():
        shown.append(listener.weighings.get().verdict.item_id)
    assert {verdict.item_id for _, verdict in faults} <= set(shown)
    assert len(set(shown)) == len(shown)


def test_a_late_mass_is_counted_and_makes_no_second_verdict(spinner: Spinner):
    line = RejectLine(spinner, rejector_distance=1.5)  # 3 s behind the eye: the machine may be busy
    line.pass_item(1)
    assert list(line.verdict().reasons) == ['NoEstimate']
    line.weigh(1)
    line.wait_for_count('late estimates', 1)
    assert line.verdicts.empty()
    # By its stamps this item is not due before now, however long the first has taken.
    line.weigh(60)
    line.pass_item(60)  # the mass is ahead of the edges
    assert line.verdict().decision == Verdict.ACCEPT


def test_without_deadlines_a_mass_is_waited_for(spinner: Spinner):
    line = RejectLine(spinner, deadlines=False, rejector_distance=0.0)
    line.pass_item(1)
    line.pass_item(2)
    line.weigh(2)
    line.weigh(1)

    assert [line.verdict().item_id, line.verdict().item_id] == [2, 1]


def test_too_many_rejects_in_a_row_stop_the_line_until_the_reset(spinner: Spinner):
    line = RejectLine(spinner, max_rejects_in_a_row=2)
    assert line.stop().state == StopRequest.RUN
    for number in (1, 2):
        line.pass_item(number)

    request = line.stop()

    assert (request.state, request.reason) == (StopRequest.STOP, 'TooManyRejects')
    assert request.item_id == 2
    assert request.hint
    assert line.reset()
    assert line.stop().state == StopRequest.RUN


def test_a_reset_while_the_driver_has_trouble_shows_the_request_again(spinner: Spinner):
    line = RejectLine(spinner)
    assert line.stop().state == StopRequest.RUN
    status = StreamStatus(START, 1, StreamState.RUNNING, text='item 1; item 2; item 3; and others')
    port = ports.DRIVER_STATUS
    driver = line.node.create_publisher(port.type, port.name, port.qos)
    driver.publish(to_message(port, status))
    first = line.stop()

    # A further trouble of the driver may have the same text, and has to be shown as well.
    assert not line.reset()
    assert line.stop() == first

    line.node.destroy_publisher(driver)  # its last message does not count any more
    wait_for(line.reset)
    while line.stop().state != StopRequest.RUN:
        pass


def test_a_step_of_the_zero_stops_the_line_until_the_belt_is_zeroed(spinner: Spinner):
    line = RejectLine(spinner)
    assert line.stop().state == StopRequest.RUN
    for number, zero in ((1, 0.0), (2, 0.1)):
        line.pass_item(number)
        line.weigh(number, zero=zero)
        assert line.verdict().decision == Verdict.ACCEPT

    request = line.stop()

    assert (request.reason, request.item_id) == ('ZeroStep', 2)
    assert request.hint.endswith(': +100.0 g before item 2')
    assert not line.reset()
    change = ZeroChange(START, 0.1, 0.1, 1e-4)
    publish(line.node, ports.ZERO_SETTING, to_message(ports.ZERO_SETTING, change))
    wait_for(line.reset)


def test_a_reject_that_nobody_sees_stops_the_line(spinner: Spinner):
    line = RejectLine(spinner, confirmation_time=2.0, rejector_distance=0.5)
    assert line.stop().state == StopRequest.RUN
    line.pass_item(1)
    # The eye is told of at once: a busy machine must not make it too late. Whichever comes first,
    # edges or eye, it waits longer for the verdict than that takes.
    reject_at = edges(1)[-1].stamp + NANOSECONDS
    edge = EyeEdge(reject_at, Eye.INFEED, True)
    publish(line.node, ports.REJECT_EYE, to_message(ports.REJECT_EYE, edge))
    assert stamp_from(line.verdict().reject_at) == reject_at
    line.pass_item(4)  # whose reject time is not near that of the first one

    request = line.stop()

    assert (request.reason, request.item_id) == ('UnconfirmedReject', 4)


LANE = 'late_edges'


def test_an_item_whose_edges_come_after_its_reject_time_is_late(spinner: Spinner):
    # 4 s behind the outfeed eye. Item 1 is judged after 0.1 s, on a busy machine later.
    line = RejectLine(spinner, rejector_distance=2.0, verdict_margin=3.9)
    line.pass_item(1)
    assert not line.verdict().late
    time.sleep(5.5)  # item 2 passes 1 s after item 1; its edges do not
    line.pass_item(2)
    line.weigh(2)
    verdict = line.verdict()
    assert (verdict.item_id, verdict.late) == (2, True)
