# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the latest item, or of the reason why the lane does not weigh."""

from collections.abc import Sequence
import math

from nicegui import ui

from checkweigher_core.records import GRAMS
from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import Row
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.view import FAST, View
from checkweigher_web.words import decided, grams, when, why

_WEIGHS = ('driver', *STAGES)
# Texts for the states of the driver in which the lane does not weigh.
_ENDED = {
    'inactive': 'weighing is stopped',
    'finished': 'weighing has ended, for the source has',
    'failed': 'weighing has ended, for the source has failed',
}


class ItemView(View):
    """Mass and verdict of the latest item, which are grey while the lane does not weigh."""

    title = 'Item'
    columns = 1, 5
    period = FAST

    def _build(self) -> None:
        self._still = ui.label('').classes('level-ERROR').props('role=status')
        self._decision = ui.label('no item yet').classes('decision NONE')
        self._mass = ui.label('–').classes('mass')
        self._about = ui.label('').classes('about')
        self._why = ui.label('').classes('level-ERROR')
        self._stop = ui.label('').classes('stop level-ERROR').props('role=alert')

    def _state(self) -> object:
        return self.lane.version, standstill(self.look.nodes())

    def _show(self) -> None:
        still, stop, item = standstill(self.look.nodes()), self.lane.stop, self.drawing.latest()
        self._stop.set_text('' if stop is None else f'STOP {stop.reason}: {stop.hint}')
        self._still.set_text(still)
        if item is None:
            return
        verdict = item.verdict
        if still:
            self._still.set_text(f'{still}, last item at {when(verdict)}')
        self._decision.set_text(decided(verdict))
        self._decision.classes(replace=f'decision {"NONE" if still else verdict.decision.name}')
        self._mass.set_text(grams(verdict.mass, ' g', digits=2))
        self._mass.classes(replace='mass still' if still else 'mass')
        self._about.set_text(about(item))
        self._why.set_text(why(verdict))


def about(item: ShownItem) -> str:
    """Return a text with further values of an item, such as its number and the belt speed."""
    verdict, known = item.verdict, item.estimate
    parts = (
        f'item {verdict.item_id}',
        'gross' if math.isfinite(verdict.mass) else '',
        f'± {GRAMS * verdict.std_dev:.2f} g' if math.isfinite(verdict.std_dev) else '',
        f'{60 * known.belt_speed:.1f} m/min' if known and math.isfinite(known.belt_speed) else '',
        known.estimator if known else '',
        f'reference {GRAMS * item.reference:.2f} g' if math.isfinite(item.reference) else '',
    )
    return ', '.join(filter(None, parts))


def standstill(rows: Sequence[Row]) -> str:
    """Return the reason in the diagnostics why a lane does not weigh, or '' if it weighs."""
    if silent := silence(rows):
        return f'silent for {silent:.0f} s'
    source = [row for row in rows if (_name(row), row.aspect) == ('driver', 'Source')]
    state = dict(source[0].values).get('state', '') if source else ''
    return _ENDED.get(state, '')


def silence(rows: Sequence[Row]) -> float:
    """Return the longest time in s for which a node that weighs has sent no diagnostics."""
    return max((row.silence for row in rows if _name(row) in _WEIGHS), default=0.0)


def _name(row: Row) -> str:
    return row.node.rpartition('/')[2]
