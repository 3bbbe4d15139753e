# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The latest item: mass and verdict, or the reason why the lane does not weigh."""

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
# Reasons of a standstill by the state of the driver.
_ENDED = {
    'inactive': 'weighing is stopped',
    'finished': 'weighing has ended, for the source has',
    'failed': 'weighing has ended, for the source has failed',
}


class ItemView(View):
    """Mass and verdict of the latest item, in letters that can be read from two metres.

    They are grey while the lane does not weigh.
    """

    title = 'Item'
    columns = 1, 5
    period = FAST
    style = """
.decision { font-size: min(11cqi, 4.5rem); line-height: 1.25; font-weight: 700; color: #fff;
  padding: 0 1rem; border-radius: 8px; }
.mass { font-size: min(19cqi, 9rem); line-height: 1.15; font-weight: 700; white-space: nowrap;
  font-variant-numeric: tabular-nums; letter-spacing: -0.02em; }
.decision.ACCEPT { background: var(--green); }
:is(.decision.UNDER, .decision.OVER) { background: var(--amber); }
.decision.FAULT { background: var(--red); }
.NONE { background: #595f69; }
.mass.still { color: var(--muted); }
.stop:not(:empty) { border: 2px solid var(--red); border-radius: 8px; padding: 0.5rem 0.75rem; }
"""

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
    """Return what else is known of an item, such as its belt speed, as text."""
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
    """Return the reason why a lane does not weigh, by its diagnostics; '' while it does."""
    if silent := silence(rows):
        return f'silent for {silent:.0f} s'
    source = [row for row in rows if (_name(row), row.aspect) == ('driver', 'Source')]
    state = dict(source[0].values).get('state', '') if source else ''
    return _ENDED.get(state, '')


def silence(rows: Sequence[Row]) -> float:
    """Return the longest silence in s of a node that weighs, by the diagnostics; or 0."""
    return max((row.silence for row in rows if _name(row) in _WEIGHS), default=0.0)


def _name(row: Row) -> str:
    return row.node.rpartition('/')[2]
