# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base classes of the views, and the state of a viewer."""

from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
import time
from typing import ClassVar

from nicegui import json

from checkweigher_core.ros.status_board import Row, StatusBoard
from checkweigher_web.charts import Options
from checkweigher_web.drawing import Drawing
from checkweigher_web.elements import Figure
from checkweigher_web.lane import ShownItem

FAST, SLOW = 0.1, 1.0  # periods of the updates in s


@dataclass
class Look:
    """State of one viewer of a lane.

    `board` is None for a recorded shift. `keep` is None if the viewer may not keep items. `chosen`
    is the key of the item that the viewer has chosen, or '' for the latest item.
    """

    drawing: Drawing
    board: StatusBoard | None = None
    keep: Callable[[ShownItem], Awaitable[None]] | None = None
    chosen: str = ''
    only_faults: bool = False

    def choose(self, key: str) -> None:
        """Choose the item with a key, or the latest item for the key ''."""
        self.chosen = key

    def nodes(self) -> list[Row]:
        """Return the diagnostics of the nodes of the lane, which are collected once a second."""
        return self.drawing.each_second('nodes', self._nodes)

    def _nodes(self) -> list[Row]:
        rows = [] if self.board is None else self.board.rows(time.monotonic())
        name = self.drawing.lane.name
        return [row for row in rows if row.node.strip('/').rpartition('/')[0] == name]


class View(ABC):
    """A panel on the page of a lane.

    A view shows the present state, so a slow browser skips items and never delays the line.

    Attributes
    ----------
    title : str
        Heading of the panel.
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
        self.look = look
        self.drawing = look.drawing
        self.lane = look.drawing.lane
        self._shown: object = None
        self._build()

    def update(self) -> None:
        """Show the present state if it has changed since the last call."""
        state = self._state()
        if state != self._shown:
            self._shown = state
            self._show()

    def _state(self) -> object:
        """Return a value that differs from the previous one if the view must be updated."""
        return self.lane.version, self.look.chosen, self.look.only_faults

    @abstractmethod
    def _build(self) -> None:
        """Add the elements of the view to its panel."""

    @abstractmethod
    def _show(self) -> None:
        """Show the present state in the elements of the view."""


class FigureView(View):
    """View with one figure of many items. `label` is the name of the figure for screen readers."""

    label: ClassVar[str]

    @classmethod
    def figure(cls, drawing: Drawing) -> str:
        """Return the figure as JSON, which is drawn again for a new item, product or batch."""
        return drawing.once(cls.label, drawing.of_items(), lambda: json.dumps(cls._draw(drawing)))

    @classmethod
    @abstractmethod
    def _draw(cls, drawing: Drawing) -> Options:
        """Return the figure."""

    def _build(self) -> None:
        self._figure = Figure(self.label)

    def _state(self) -> object:
        return self.drawing.of_items()

    def _show(self) -> None:
        self._figure.show_text(self.figure(self.drawing))
