# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the latest item, or of the chosen item in a recorded shift.

If a running lane does not weigh, the view also shows the reason.
"""

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
from checkweigher_web.elements import Reading, show_told
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.languages.wording import from_node
from checkweigher_web.languages.words import why
from checkweigher_web.views.masses import limit_label, limits_of
from checkweigher_web.views.view import FAST, View

_DOTS = 20  # maximum number of items on the scale, including the item of the reading
_ROOM = 0.12  # margins of the scale outside the limits, as a fraction of their range
_NARROWEST = 300  # width in px of the scale on a phone
_WEIGHS = ('driver', *STAGES)
# Reasons why a lane does not weigh, by the state of its driver.
ENDED = {
    'inactive': Text('weighing is stopped'),
    'finished': Text('weighing has ended, for the source has'),
    'failed': Text('weighing has ended, for the source has failed'),
}


class ItemView(View):
    """Mass and verdict of the latest item with a scale, in grey if the lane does not weigh.

    In a recorded shift, the view shows the chosen item instead of the latest item.
    """

    title = Text('Item')
    columns = 2, 12
    period = FAST

    def _build(self) -> None:
        self._still = ui.label('').classes('still level-ERROR').props('role=status')
        self._reading = Reading(self.say)
        with ui.element('div').classes('stop level-ERROR').props('role=alert') as self._stop:
            self._request = ui.label('')
            self._more = ui.label('')
            if 'Reset stop' in self.look.work:
                ui.button(self.say('Reset stop'), on_click=self.look.work['Reset stop']).props(
                    'outline'
                )

    def _state(self) -> object:
        return super()._state(), standstill(self.look.nodes())

    def _show(self) -> None:
        still, stop = standstill(self.look.nodes()), self.lane.stop
        live = self.look.board is not None
        # A running lane shows the latest item, and a recorded shift shows the chosen item.
        item = self.drawing.latest() if live else self.look.item()
        self._stop.set_visibility(stop is not None)
        self._request.set_text(
            '' if stop is None else f'STOP {stop.reason}: {self.say(stop.reason.hint)}'
        )
        if stop is not None:
            show_told(self._more, from_node(stop.text), self.say)
        self._still.set_text(self.say(still))
        if still and item:
            at = self.say.clock(item.verdict.time)
            self._still.set_text(self.say('{still}, last item at {time}', still=still, time=at))
        if item is not None:
            state = self.lane.version, row_key(item)
            name = 'reading', self.say
            text = self.drawing.once(name, state, lambda: self._draw(item))
            age = time.monotonic() - self.lane.judged if live else None
            self._reading.show(text, age, still=bool(still))

    def _draw(self, item: ShownItem) -> str:
        items = self.drawing.items()
        at = [row_key(each) for each in items].index(row_key(item))
        return json.dumps(reading(item, items[at:], self.lane.statistics, self.say))


def reading(
    item: ShownItem,
    items: Sequence[ShownItem],
    statistics: Statistics | None,
    say: Language = ENGLISH,
) -> dict[str, object]:
    """Return the content of a `Reading` for an item, by the keys that reading.js uses.

    `items` contains `item` and the items before it, the latest item first. Of the first
    `_DOTS` items, the scale shows the items with a mass that have the product and batch of `item`.
    """
    verdict = item.verdict
    return {
        'decision': verdict.decision.name,
        'word': say(verdict.decision.name),
        'mass': say.mass(verdict.mass, 2),
        'about': about(item, say),
        'why': why(verdict, say),
        'scale': _scale(verdict, [each.verdict for each in items[:_DOTS]], statistics, say),
    }


def _scale(
    verdict: Verdict, latest: Sequence[Verdict], statistics: Statistics | None, say: Language
) -> dict[str, object] | None:
    """Return a scale of limits and masses as positions from 0 to 1, or None if both are missing."""
    of = verdict.product, verdict.batch
    limits = limits_of(*of, verdict, statistics)
    weighed = [each for each in latest if math.isfinite(each.mass)]
    shown = [each for each in weighed if of == (each.product, each.batch)]
    ruler = _ruler([*limits.values()], [GRAMS * each.mass for each in shown])
    if ruler is None:
        return None
    labels = {limit_label(name, mass, say): ruler.at(mass) for name, mass in limits.items()}
    rows = stacked({name: _NARROWEST * place for name, place in labels.items()})
    dots = [(each, ruler.at(GRAMS * each.mass)) for each in shown]
    return {
        'label': say(
            'scale of {low} to {high} with the latest items',
            low=say.mass(ruler.low / GRAMS, 1),
            high=say.mass(ruler.high / GRAMS, 1),
        ),
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
        """Return the position of a mass in g, from 0 at `low` to 1 at `high`.

        A mass outside the scale has the position of the nearer end.
        """
        return round(min(max((mass - self.low) / (self.high - self.low), 0.0), 1.0), 4)


def _ruler(limits: Sequence[float], masses: Sequence[float]) -> _Ruler | None:
    """Return a scale for limits in g, and also for masses in g if there are fewer than two limits.

    Returns None if there are neither limits nor masses.
    """
    places = limits if len(limits) > 1 else [*limits, *masses]
    if not places:
        return None
    room = _ROOM * ((max(places) - min(places)) or 1.0)
    return _Ruler(min(places) - room, max(places) + room)


def about(item: ShownItem, say: Language = ENGLISH) -> str:
    """Return a text with further values of an item, such as its number and the belt speed.

    Unknown values are left out.
    """
    verdict, known = item.verdict, item.estimate
    parts = (
        say('item {number}', number=verdict.item_id),
        say('gross') if math.isfinite(verdict.mass) else '',
        f'± {say.mass(verdict.std_dev, 2)}' if math.isfinite(verdict.std_dev) else '',
        say.number(60 * known.belt_speed, 1, ' m/min')
        if known and math.isfinite(known.belt_speed)
        else '',
        known.estimator if known else '',
        say('no limits')
        if math.isinf(verdict.lower_limit) and math.isinf(verdict.upper_limit)
        else '',
        say('reference {mass}', mass=say.mass(item.reference, 2))
        if math.isfinite(item.reference)
        else '',
    )
    return ', '.join(filter(None, parts))


def standstill(rows: Sequence[Row]) -> str:
    """Return the reason why a lane does not weigh, from its diagnostics.

    Returns '' if the lane weighs, or if the state of its driver is not known.
    """
    if silent := silence(rows):
        return Text('silent for {seconds} s', seconds=round(silent))
    source = [row for row in rows if (_name(row), row.aspect) == ('driver', 'Source')]
    state = dict(source[0].values).get('state', '') if source else ''
    if state in ('', 'running'):
        return ''
    return ENDED.get(state, Text('unknown state {state}', state=repr(state)))


def silence(rows: Sequence[Row]) -> float:
    """Return the longest silence in s of the nodes that weigh, or 0 if none of them is silent."""
    return max((row.silence for row in rows if _name(row) in _WEIGHS), default=0.0)


def _name(row: Row) -> str:
    return row.node.rpartition('/')[2]
