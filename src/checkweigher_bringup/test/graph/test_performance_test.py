# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Performance test of a recipe over real DDS: reminder, stop, passes, and audit log entry."""

from pathlib import Path
from typing import Any

from checkweigher_msgs.srv import BeginTest
from graph import wait_for
from product_line import Line
import pytest
from running import start_command
from std_srvs.srv import Trigger

from checkweigher_bringup.spinning import Spinner
from checkweigher_core.ros import ports


class Watched:
    """Line with the product `tested`, and its states of the overdue test and of the stop."""

    def __init__(self, spinner: Spinner, folder: Path) -> None:
        self.line = Line(spinner, folder, product='tested')
        self.tests: list[Any] = []
        self.stops: list[Any] = []
        self.line.listen(ports.PERFORMANCE_TEST, self.tests.append)
        self.line.listen(ports.STOP_REQUEST, self.stops.append)
        self.wait_for_state('OVERDUE')

    def wait_for_state(self, name: str) -> Any:
        wait_for(lambda: self.tests and self.tests[-1].state == getattr(self.tests[-1], name))
        return self.tests[-1]

    def wait_for_stop(self, reason: str) -> None:
        wait_for(lambda: self.stops and self.stops[-1].reason == reason)

    def begin(self, who: str = 'ann', **others: object) -> Any:
        return self.line.call(BeginTest, 'begin_test', who=who, **others)

    def reset(self) -> Any:
        return self.line.call(Trigger, 'reset_stop_request')

    def wait_until_accepting(self) -> None:
        wait_for(lambda: not self.line.products[-1].performance_test)


@pytest.fixture
def watched(spinner: Spinner, tmp_path: Path) -> Watched:
    return Watched(spinner, tmp_path)


def test_an_overdue_test_stops_the_line_until_one_has_passed(watched: Watched):
    watched.wait_for_stop('PerformanceTest')
    assert not watched.reset().success  # it lasts
    assert not watched.begin(who=' ').success

    assert watched.begin(reason='shift').success
    watched.wait_for_state('RUNNING')
    assert not watched.begin(who='bob').success
    wait_for(lambda: watched.reset().success)
    first = watched.line.judge(0.1002)
    assert (first.decision, list(first.reasons)) == (first.FAULT, ['PerformanceTest'])
    assert first.mass == 0.1002
    watched.line.judge(0.0998)

    state = watched.wait_for_state('IN_TIME')
    assert list(state.errors) == pytest.approx([2e-4, -2e-4], abs=1e-9)
    assert (state.who, state.due.sec - state.last.sec) == ('claimed:ann', 8 * 3600)
    watched.wait_until_accepting()
    good = watched.line.judge(0.1)
    assert (good.decision, good.batch_items, good.batch_accepted) == (good.ACCEPT, 3, 1)
    begun, ended = watched.line.entries('test_begun')[0], watched.line.entries('test')[0]
    assert (begun.who, begun.why, ended.who, ended.why) == (
        *('claimed:ann', 'shift'),
        *('claimed:ann', 'shift'),
    )
    assert (ended.subject, ended.new['passed'], ended.new['mass']) == ('tested', True, 0.1)


def test_a_failed_test_stops_the_line_and_counts_after_a_restart(watched: Watched):
    assert watched.begin().success
    watched.wait_for_state('RUNNING')
    for mass in (0.1002, 0.1006):
        watched.line.judge(mass)
    assert '1 of 2 passes of claimed:ann beyond 0.5 g' in watched.wait_for_state('FAILED').text
    watched.wait_for_stop('PerformanceTest')

    watched.wait_until_accepting()
    watched.tests.clear()
    watched.line.restart_product()
    assert watched.wait_for_state('FAILED').who == 'claimed:ann'


def test_the_command_guides_and_ends_with_the_result(watched: Watched):
    for masses, status in (((0.1, 0.1001), 0), ((0.1, 0.102), 1)):
        options = '--who ann --namespace lane1 --timeout 60'
        with start_command('performance', *options.split(), stderr=None) as guide:
            watched.wait_for_state('RUNNING')
            for mass in masses:
                watched.line.judge(mass)
            text, _ = guide.communicate()
        watched.wait_until_accepting()
        assert guide.returncode == status, text
        assert text.splitlines()[-1].startswith('FAILED: 1 of 2' if status else 'passed')
        assert 'pass 1 of 2: error +0.000 g, within 0.5 g' in text


def test_a_recipe_without_a_test_asks_for_none(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, product='nuts')
    tests: list[Any] = []
    line.listen(ports.PERFORMANCE_TEST, tests.append)
    wait_for(lambda: tests and tests[-1].state == tests[-1].NOT_ASKED)
    refused = line.call(BeginTest, 'begin_test', who='ann')
    assert refused.message == 'the recipe of the product asks for no performance test'
