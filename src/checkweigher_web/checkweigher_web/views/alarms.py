# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the alarms of a lane."""

from nicegui import ui

from checkweigher_core.records import Alarm
from checkweigher_web.elements import Table
from checkweigher_web.views.view import View
from checkweigher_web.words import clock


class AlarmsView(View):
    """The alarms that last or that no user has acknowledged, the latest alarm first."""

    title = 'Alarms'
    recorded = False

    def _build(self) -> None:
        self._headline = ui.label('').classes('about')
        self._rows = Table(('alarm', 'first', 'last', 'times', 'state', 'what to check'))

    def _state(self) -> object:
        return self.lane.alarms

    def _show(self) -> None:
        alarms = sorted(self.lane.alarms, key=lambda each: -each.last)
        waiting = sum(not each.acknowledged_by for each in alarms)
        self._headline.set_text(f'{waiting} not acknowledged')
        self._rows.show(
            (
                f'{each.source} {each.reason}',
                clock(each.first),
                clock(each.last),
                str(each.count),
                state_of(each),
                each.text,
            )
            for each in alarms
        )


def state_of(alarm: Alarm) -> str:
    """Return a text on the duration and the acknowledgement of an alarm."""
    parts = ['lasts'] if alarm.active else []
    parts += [f'{alarm.duration:.0f} s'] if alarm.duration else []
    parts += [f'acknowledged by {alarm.acknowledged_by}'] if alarm.acknowledged_by else []
    return ', '.join(parts) or 'not acknowledged'
