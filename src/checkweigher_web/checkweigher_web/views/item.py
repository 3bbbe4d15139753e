# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the latest item, or of the reason why the lane does not weigh."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
import time

from nicegui import json, ui

from checkweigher_core.records import GRAMS, Statistics, Verdict
from checkweigher_core.ros.ports import STAGES
from checkweigher_core.ros.status_board import Row
from checkweigher_web.charts import stacked
from checkweigher_web.drawing import row_key
from checkweigher_web.elements import Reading
from checkweigher_web.lane import ShownItem
from checkweigher_web.views.masses import limits_of
from checkweigher_web.views.view import FAST, View
from checkweigher_web.words import grams, when, why

_DOTS = 20  # maximum number of items on the scale
_ROOM = 0.12  # margins of the scale outside the limits, as a fraction of their range
_NARROWEST = 300  # width in px of the scale on a phone
_WEIGHS = ('driver', *STAGES)
# Texts for the states of the driver in which the lane does not weigh.
ENDED = {
    'inactive': 'weighing is stopped',
    'finished': 'weighing has ended, for the source has',
    'failed': 'weighing has ended, for the source has failed',
}


class ItemView(View):
    """Mass and verdict of the latest item with a scale, grey while the lane does not weigh."""

    title = 'Item'
    columns = 2, 12
    period = FAST

    def _build(self) -> None:
        self._still = ui.label('').classes('still level-ERROR').props('role=status')
        self._reading = Reading()
        with ui.element('div').classes('stop level-ERROR').props('role=alert') as self._stop:
            self._request = ui.label('')
            if 'Reset stop' in self.look.work:
                ui.button('Reset stop', on_click=self.look.work['Reset stop']).props('outline')

    def _state(self) -> object:
        return super()._state(), standstill(self.look.nodes())

    def _show(self) -> None:
        still, stop = standstill(self.look.nodes()), self.lane.stop
        live = self.look.board is not None  # A recorded shift shows the chosen item instead.
        item = self.drawing.latest() if live else self.look.item()
        self._stop.set_visibility(stop is not None)
        self._request.set_text('' if stop is None else f'STOP {stop.reason}: {stop.hint}')
        last = f', last item at {when(item.verdict)}' if still and item else ''
        self._still.set_text(f'{still}{last}')
        if item is not None:
            state = self.lane.version, row_key(item)
            text = self.drawing.once('reading', state, lambda: self._draw(item))
            age = time.monotonic() - self.lane.judged if live else None
            self._reading.show(text, age, still=bool(still))

    def _draw(self, item: ShownItem) -> str:
        items = self.drawing.items()
        at = [row_key(each) for each in items].index(row_key(item))
        return json.dumps(reading(item, items[at:], self.lane.statistics))


def reading(
    item: ShownItem, items: Sequence[ShownItem], statistics: Statistics | None
) -> dict[str, object]:
    """Return the reading of an item, with a scale that also shows the first of `items`."""
    verdict = item.verdict
    return {
        'decision': verdict.decision.name,
        'mass': grams(verdict.mass, ' g', digits=2),
        'about': about(item),
        'why': why(verdict),
        'scale': _scale(verdict, [each.verdict for each in items[:_DOTS]], statistics),
    }


def _scale(
    verdict: Verdict, latest: Sequence[Verdict], statistics: Statistics | None
) -> dict[str, object] | None:
    """Return a scale with limits and masses as positions from 0 to 1, or None without them."""
    of = verdict.product, verdict.batch
    limits = limits_of(*of, verdict, statistics)
    weighed = [each for each in latest if math.isfinite(each.mass)]
    shown = [each for each in weighed if of == (each.product, each.batch)]
    ruler = _ruler([*limits.values()], [GRAMS * each.mass for each in shown])
    if ruler is None:
        return None
    labels = {f'{name} {mass:g}': ruler.at(mass) for name, mass in limits.items()}
    rows = stacked({name: _NARROWEST * place for name, place in labels.items()})
    dots = [(each, ruler.at(GRAMS * each.mass)) for each in shown]
    return {
        'label': f'scale of {ruler.low:.1f} to {ruler.high:.1f} g with the latest items',
        'accepted': [ruler.at(GRAMS * each) for each in (verdict.lower_limit, verdict.upper_limit)],
        'limits': [[name, place, rows[name]] for name, place in labels.items()],
        'dots': [[place, each.decision.name] for each, place in dots if each is not verdict],
        'at': next((place for each, place in dots if each is verdict), None),
    }


@dataclass(frozen=True, slots=True)
class _Ruler:
    """Scale from `low` to `high` in g."""

    low: float
    high: float

    def at(self, mass: float) -> float:
        """Return the position of a mass in g, from 0 to 1."""
        return round(min(max((mass - self.low) / (self.high - self.low), 0.0), 1.0), 4)


def _ruler(limits: Sequence[float], masses: Sequence[float]) -> _Ruler | None:
    """Return the scale for two limits in g, otherwise for the limits and masses in g."""
    places = limits if len(limits) > 1 else [*limits, *masses]
    if not places:
        return None
    room = _ROOM * ((max(places) - min(places)) or 1.0)
    return _Ruler(min(places) - room, max(places) + room)


def about(item: ShownItem) -> str:
    """Return a text with further values of an item, such as its number and the belt speed."""
    verdict, known = item.verdict, item.estimate
    parts = (
        f'item {verdict.item_id}',
        'gross' if math.isfinite(verdict.mass) else '',
        f'± {GRAMS * verdict.std_dev:.2f} g' if math.isfinite(verdict.std_dev) else '',
        f'{60 * known.belt_speed:.1f} m/min' if known and math.isfinite(known.belt_speed) else '',
        known.estimator if known else '',
        'no limits' if math.isinf(verdict.lower_limit) and math.isinf(verdict.upper_limit) else '',
        f'reference {GRAMS * item.reference:.2f} g' if math.isfinite(item.reference) else '',
    )
    return ', '.join(filter(None, parts))


def standstill(rows: Sequence[Row]) -> str:
    """Return the reason in the diagnostics why a lane does not weigh, or '' if it weighs."""
    if silent := silence(rows):
        return f'silent for {silent:.0f} s'
    source = [row for row in rows if (_name(row), row.aspect) == ('driver', 'Source')]
    state = dict(source[0].values).get('state', '') if source else ''
    return '' if state in ('', 'running') else ENDED.get(state, f'unknown state {state!r}')


def silence(rows: Sequence[Row]) -> float:
    """Return the longest time in s for which a node that weighs has sent no diagnostics."""
    return max((row.silence for row in rows if _name(row) in _WEIGHS), default=0.0)


def _name(row: Row) -> str:
    return row.node.rpartition('/')[2]
