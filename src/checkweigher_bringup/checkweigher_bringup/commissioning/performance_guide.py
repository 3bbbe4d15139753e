# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Performance test on a running line, over which a person sends a test product several times."""

import math
import queue
import time

from checkweigher_msgs.srv import BeginTest

from checkweigher_bringup.commissioning.lane_client import PATIENCE, call
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_core.records import GRAMS, PerformanceState, PerformanceTest
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode


def make_test(lane: str, who: str, reason: str, timeout: float) -> bool:
    """Begin a performance test, print each pass, and return whether the test has passed.

    `lane` is the namespace of the lane. The name `who` of the person and the `reason` of the test
    are written to the audit log. The test is cancelled if the user interrupts it or if it takes
    longer than `timeout` s.

    Raises `UserError` if the line does not answer or refuses the test, or if the test takes longer
    than `timeout` s.
    """
    with spinning(lane) as spinner:
        node = PortNode('performance')
        states: queue.Queue[PerformanceTest] = queue.Queue()
        node.subscribe(ports.PERFORMANCE_TEST, states.put)
        spinner.add(node)
        # Wait for a message before the test, because otherwise the first passes might be missed.
        topic = node.resolve_topic_name(ports.PERFORMANCE_TEST.name)
        absent = f'no message on {topic}: is the line running, with a product selected?'
        before = _next(states, PATIENCE, absent)
        begun = call(node, BeginTest, ports.BEGIN_TEST, who=who, reason=reason)
        print(begun.message, flush=True)
        print('every item is rejected until the test has ended', flush=True)
        try:
            return _follow(states, before, timeout)
        except BaseException:
            call(node, BeginTest, ports.BEGIN_TEST, who=who, reason='interrupted', cancel=True)
            raise


def _next(states: queue.Queue[PerformanceTest], patience: float, absent: str) -> PerformanceTest:
    """Return the next state of the test, or raise `UserError(absent)` after `patience` s."""
    try:
        return states.get(timeout=max(0.0, patience))
    except queue.Empty:
        raise UserError(absent) from None


def _follow(states: queue.Queue[PerformanceTest], before: PerformanceTest, timeout: float) -> bool:
    """Print each pass when it is published, and return whether the test has passed.

    `before` is the state before the test. The first state after `before` may already be the end of
    the test. Raises `UserError` if the test does not end within `timeout` s.
    """
    end, shown, begun = time.monotonic() + timeout, 0, False
    while True:
        absent = f'no {"end" if begun else "start"} of the test within {timeout:g} s'
        state = _next(states, end - time.monotonic(), absent)
        is_running = state.state is PerformanceState.RUNNING
        begun |= state.stamp > before.stamp and (is_running or len(state.errors) > 0)
        if not begun:
            continue
        for number in range(shown, len(state.errors)):
            print(_pass(number, state), flush=True)
        shown = len(state.errors)
        if not is_running:
            return _conclude(state)


def _pass(number: int, state: PerformanceTest) -> str:
    error = state.errors[number]
    begin = f'pass {number + 1} of {state.passes}: '
    if math.isnan(error):
        return f'{begin}no mass'
    within = 'within' if abs(error) <= state.limit else 'BEYOND'
    return f'{begin}error {GRAMS * error:+.3f} g, {within} {GRAMS * state.limit:g} g'


def _conclude(state: PerformanceTest) -> bool:
    full = len(state.errors) >= state.passes > 0
    passed = full and all(abs(each) <= state.limit for each in state.errors)
    print('passed' if passed else f'FAILED: {state.text or "the test was cancelled"}', flush=True)
    return passed
