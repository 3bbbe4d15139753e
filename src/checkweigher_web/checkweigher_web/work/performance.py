# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of the performance test, with the error of each pass of the test product."""

import math

from nicegui import ui

from checkweigher_core.records import GRAMS, PerformanceState, PerformanceTest
from checkweigher_core.ros import ports
from checkweigher_web.work.dialogs import Desk, ask
from checkweigher_web.work.services import ACTING, LaneServices, Person

_PERIOD = 0.5  # s
_STATES = {
    PerformanceState.OVERDUE: 'Overdue: the line is asked to stop until a test has passed',
    PerformanceState.NOT_ASKED: 'The recipe asks for no performance test',
    PerformanceState.IN_TIME: 'In time',
    PerformanceState.DUE: 'Due',
    PerformanceState.RUNNING: 'The test goes on: every item is rejected',
    PerformanceState.FAILED: 'Failed: the line is asked to stop until a test has passed',
}


async def performance_test(desk: Desk, services: LaneServices) -> None:
    """Show the state of the performance test, and ask whether to begin it or to cancel it."""
    running = services.test is not None and services.test.state is PerformanceState.RUNNING
    verb = 'Break off' if running else 'Begin'

    async def act() -> str:
        person, reason = ACTING.get() or (Person('', ''), '')
        who = person.name
        return await services.message(ports.BEGIN_TEST, who=who, reason=reason, cancel=running)

    text = 'Let the test product pass as often as is asked for. Every item is rejected meanwhile.'
    plan = f'{verb.lower()} performance test', act
    with ask(desk, 'Performance test', text, verb, lambda: plan):
        shown = ui.label('').classes('read').props('role=status')
        ui.timer(_PERIOD, lambda: shown.set_text(text_of(services.test)))


def text_of(test: PerformanceTest | None) -> str:
    """Return the state of the test as one line of text."""
    if test is None:
        return 'Nothing is known of a performance test: no product is selected'
    text = _STATES[test.state]
    if test.text:
        text += f' ({test.text})'
    if test.errors or test.state is PerformanceState.RUNNING:
        errors = ('no mass' if math.isnan(e) else f'{GRAMS * e:+.2f} g' for e in test.errors)
        known = ', '.join(errors) or 'none yet'
        text += f'. {len(test.errors)} of {test.passes} passes: {known}'
    return text
