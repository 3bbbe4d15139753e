# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A performance test on a running line, with the person who lets the test product pass."""

import math
import time

from checkweigher_msgs.srv import BeginTest

from checkweigher_bringup.commissioning.service_call import ask
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_core.records import GRAMS, PerformanceState, PerformanceTest
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode

_PATIENCE = 5.0  # s, for the line to be found, and for an answer
_POLL_PERIOD = 0.05  # s


def make_test(lane: str, who: str, reason: str, timeout: float) -> bool:
    """Begin the test, show each pass, and return whether it has passed.

    What is interrupted, or takes longer than `timeout`, s, is broken off. `UserError` says why it
    cannot be made.
    """
    with spinning(lane) as spinner:
        node = PortNode('performance')
        states: list[PerformanceTest] = []
        node.subscribe(ports.PERFORMANCE_TEST, states.append)
        spinner.add(node)
        _wait_for_line(node, states)  # else the first passes may be over before they are heard
        before = states[-1]
        request = BeginTest.Request(who=who, reason=reason)
        print(ask(node, BeginTest, ports.BEGIN_TEST, _PATIENCE, request), flush=True)
        print('every item is rejected until the test has ended', flush=True)
        try:
            return _follow(states, before, timeout)
        except BaseException:
            request = BeginTest.Request(who=who, reason='interrupted', cancel=True)
            ask(node, BeginTest, ports.BEGIN_TEST, _PATIENCE, request)
            raise


def _wait_for_line(node: PortNode, states: list[PerformanceTest]) -> None:
    end = time.monotonic() + _PATIENCE
    while not states:
        if time.monotonic() > end:
            topic = node.resolve_topic_name(ports.PERFORMANCE_TEST.name)
            raise UserError(f'nothing on {topic}: is the line running, with a product selected?')
        time.sleep(_POLL_PERIOD)


def _follow(states: list[PerformanceTest], before: PerformanceTest, timeout: float) -> bool:
    """Show the passes as they come; return whether the test has passed.

    `before` is the state before the test. A fast test has ended before it is seen to run.
    """
    end, shown, begun = time.monotonic() + timeout, 0, False
    while True:
        state = states[-1]
        is_newer = state.stamp > before.stamp
        begun |= is_newer and (state.state is PerformanceState.RUNNING or len(state.errors) > 0)
        if begun:
            for number in range(shown, len(state.errors)):
                print(_pass(number, state), flush=True)
            shown = max(shown, len(state.errors))
            if state.state is not PerformanceState.RUNNING:
                return _conclude(state)
        if time.monotonic() > end:
            raise UserError(f'no {"end" if begun else "begin"} of the test within {timeout:g} s')
        time.sleep(_POLL_PERIOD)


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
    print('passed' if passed else f'FAILED: {state.text or "it was broken off"}', flush=True)
    return passed
