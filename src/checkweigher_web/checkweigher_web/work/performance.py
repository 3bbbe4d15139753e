# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog of the performance test, which shows the error of each pass of the test product."""

import math

from nicegui import ui

from checkweigher_core.records import PerformanceState, PerformanceTest
from checkweigher_core.ros import ports
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.work.dialogs import Desk, ask
from checkweigher_web.work.services import ACTING, LaneServices, Person

_PERIOD = 0.5  # s
_STATES = {
    PerformanceState.OVERDUE: Text('Overdue: the line is asked to stop until a test has passed'),
    PerformanceState.NOT_ASKED: Text('The recipe asks for no performance test'),
    PerformanceState.IN_TIME: Text('In time'),
    PerformanceState.DUE: Text('Due'),
    PerformanceState.RUNNING: Text('The test goes on: every item is rejected'),
    PerformanceState.FAILED: Text('Failed: the line is asked to stop until a test has passed'),
}


async def performance_test(desk: Desk, services: LaneServices) -> None:
    """Show the state of the performance test, and ask whether to begin it or to cancel it."""
    running = services.test is not None and services.test.state is PerformanceState.RUNNING
    verb = Text('Break off') if running else Text('Begin')
    what = Text('break off performance test') if running else Text('begin performance test')

    async def act() -> str:
        person, reason = ACTING.get() or (Person('', ''), '')
        who = person.name
        return await services.message(ports.BEGIN_TEST, who=who, reason=reason, cancel=running)

    text = Text(
        'Let the test product pass as often as is asked for. Every item is rejected meanwhile.'
    )
    with ask(desk, Text('Performance test'), text, verb, lambda: (what, act)):
        shown = ui.label('').classes('read').props('role=status')
        ui.timer(_PERIOD, lambda: shown.set_text(text_of(services.test, desk.say)))


def text_of(test: PerformanceTest | None, say: Language = ENGLISH) -> str:
    """Return the state of the performance test as one line, with the errors of its passes."""
    if test is None:
        return say('Nothing is known of a performance test: no product is selected')
    text = say(_STATES[test.state])
    if test.text:
        text += f' ({say(from_node(test.text))})'
    if test.errors or test.state is PerformanceState.RUNNING:
        errors = (
            say('no mass') if math.isnan(error) else say.mass(error, 2, '+')
            for error in test.errors
        )
        return say(
            '{state}. {count} of {passes} passes: {errors}',
            state=text,
            count=len(test.errors),
            passes=test.passes,
            errors=', '.join(errors) or say('none yet'),
        )
    return text
