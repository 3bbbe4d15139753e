# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base classes of the views, and the state of a viewer."""

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import reduce
import math
import time
from typing import TYPE_CHECKING, ClassVar

from nicegui import json

from checkweigher_core.records import Decision
from checkweigher_core.ros.status_board import Row, StatusBoard
from checkweigher_web.charts import Options
from checkweigher_web.drawing import Drawing, row_key
from checkweigher_web.elements import Figure
from checkweigher_web.lane import ShownItem, Span
from checkweigher_web.languages.language import ENGLISH, Language
from checkweigher_web.mass_series import MassSeries

if TYPE_CHECKING:
    from checkweigher_web.technician.practice import Practice

FAST, SLOW = 0.1, 1.0  # periods of the updates in s


@dataclass
class Look:
    """Data that the page shows to one viewer of a lane, with the choices and rights of the viewer.

    `board` contains the diagnostics, or is None for a recorded shift. `keep` writes an item as a
    bag, or is None if the viewer may not keep items. `work` maps the label of each allowed action
    to a function that opens its dialog. `practice` gives access to a simulated machine, or is None
    if the viewer may not change it. `chosen` is the key of the item that the viewer has chosen, or
    '' for the latest item. `only_faults` is true if the viewer has selected only faults. `span` is
    the selected part of the time axis, or None for the whole axis. `say` is the language of the
    viewer.
    """

    drawing: Drawing
    board: StatusBoard | None = None
    keep: Callable[[ShownItem], Awaitable[None]] | None = None
    work: dict[str, Callable[[], Awaitable[None]]] = field(default_factory=dict)
    practice: 'Practice | None' = None
    chosen: str = ''
    only_faults: bool = False
    span: Span | None = None
    say: Language = ENGLISH

    def choose(self, key: str) -> None:
        """Choose the item whose key is `key`, or the latest item if `key` is ''."""
        self.chosen = key

    def items(self) -> list[ShownItem]:
        """Return the items that the viewer has selected, the latest item first."""
        if self.span is None:
            return self.drawing.items(only_faults=self.only_faults)
        lane = self.drawing.lane
        return (lane.faults if self.only_faults else lane.items)(self.span)

    def item(self) -> ShownItem | None:
        """Return the chosen item if it is selected, otherwise the latest of the selected items.

        Returns None if no items are selected.
        """
        return self._item_of(self.items())

    def _item_of(self, items: list[ShownItem]) -> ShownItem | None:
        latest = next(iter(items), None)
        if not self.chosen:
            return latest
        return next((each for each in items if row_key(each) == self.chosen), latest)

    def series(self) -> MassSeries:
        """Return the mass series of the lane, or of the items in `span` if it is not None."""
        if self.span is None:
            return self.drawing.lane.series
        verdicts = (item.verdict for item in reversed(self.drawing.lane.items(self.span)))
        return reduce(MassSeries.with_item, verdicts, MassSeries())

    def move(self, step: float, *, faults: bool) -> bool:
        """Choose the next selected item in one direction, and return whether there is one.

        `step` is positive for a later item and negative for an earlier one. An infinite step leads
        to the last or first item. The step starts at the chosen item, or at the latest item if no
        selected item is chosen. If `faults` is true, only faults can be chosen.
        """
        items = self.items()[::-1]
        keys = [row_key(item) for item in items]
        at = keys.index(self.chosen) if self.chosen in keys else len(items) - 1
        wanted = (
            k
            for k, item in enumerate(items)
            if item.verdict.decision == Decision.FAULT or not faults
        )
        places = [k for k in wanted if (k > at if step > 0 else k < at)]
        if not places:
            return False
        nearest, farthest = (places[0], places[-1]) if step > 0 else (places[-1], places[0])
        self.choose(keys[farthest if math.isinf(step) else nearest])
        return True

    def place(self) -> tuple[int, int]:
        """Return the place of the shown item among the selected items, and their number.

        The place is 1 for the earliest item, and 0 if there are no items.
        """
        items = self.items()
        item = self._item_of(items)
        return (0 if item is None else len(items) - items.index(item)), len(items)

    def nodes(self) -> list[Row]:
        """Return the diagnostics of the nodes of the lane, which are updated once a second.

        Returns [] for a recorded shift.
        """
        return self.drawing.each_second('nodes', self._nodes)

    def _nodes(self) -> list[Row]:
        rows = [] if self.board is None else self.board.rows(time.monotonic())
        name = self.drawing.lane.name
        return [row for row in rows if row.node.strip('/').rpartition('/')[0] == name]


class View(ABC):
    """Panel on the page of a lane or a recorded shift.

    A view shows only the present state. A slow browser therefore skips items, and never delays the
    line.

    Attributes
    ----------
    title : str
        Heading of the panel in English.
    columns : tuple of int
        Width of the panel in columns, of 2 columns on a tablet and of 12 on a desktop.
    period : float
        Period of the updates in s. In a recorded shift, the period of all views is `FAST`.
    live, recorded : bool
        Whether the view is shown for a running lane, and for a recorded shift.
    """

    title: ClassVar[str]
    columns: ClassVar[tuple[int, int]] = 1, 4
    period: ClassVar[float] = SLOW
    live: ClassVar[bool] = True
    recorded: ClassVar[bool] = True

    def __init__(self, look: Look) -> None:
        self.look, self.say = look, look.say
        self.drawing = look.drawing
        self.lane = look.drawing.lane
        self._shown: object = None
        self._build()

    def update(self) -> None:
        """Show the present state if it has changed since the previous call."""
        state = self._state()
        if state != self._shown:
            self._shown = state
            self._show()

    def _state(self) -> object:
        """Return a value that changes when the view must be updated."""
        return self.lane.version, self.look.chosen, self.look.only_faults, self.look.span

    @abstractmethod
    def _build(self) -> None:
        """Add the elements of the view to its panel."""

    @abstractmethod
    def _show(self) -> None:
        """Show the present state in the elements of the view."""


class FigureView(View):
    """View with one figure of many items. Screen readers read the translation of `label`."""

    label: ClassVar[str]

    @classmethod
    def figure(cls, look: Look) -> str:
        """Return the figure as JSON.

        The figure of the whole time axis is cached until there is a new item, product or batch.
        """
        if look.span is not None:
            return json.dumps(cls._draw(look))
        state = look.drawing.of_items()
        name = cls.label, look.say
        return look.drawing.once(name, state, lambda: json.dumps(cls._draw(look)))

    @classmethod
    @abstractmethod
    def _draw(cls, look: Look) -> Options:
        """Return the figure of the items that the viewer has selected."""

    def _build(self) -> None:
        self._figure = Figure(self.say(self.label), self.say)

    def _state(self) -> object:
        return self.drawing.of_items(), self.look.span

    def _show(self) -> None:
        self._figure.show_text(self.figure(self.look))
