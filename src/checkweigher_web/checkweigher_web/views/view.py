# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base classes of the views, and the state of one viewer."""

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

FAST, SLOW = 0.1, 1.0  # periods of updates in s


@dataclass
class Look:
    """State of one viewer of a lane.

    `board` is None for a recorded shift, and `keep` for a viewer who may not keep items.
    `chosen` is the key of the item that the viewer has chosen, '' for the latest one.
    """

    drawing: Drawing
    board: StatusBoard | None = None
    keep: Callable[[ShownItem], Awaitable[None]] | None = None
    chosen: str = ''
    only_faults: bool = False

    def choose(self, key: str) -> None:
        """Choose an item by its key; '' for the latest one."""
        self.chosen = key

    def nodes(self) -> list[Row]:
        """Return the diagnostics of the nodes of the lane, made once a second for all viewers."""
        return self.drawing.each_second('nodes', self._nodes)

    def _nodes(self) -> list[Row]:
        rows = [] if self.board is None else self.board.rows(time.monotonic())
        name = self.drawing.lane.name
        return [row for row in rows if row.node.strip('/').rpartition('/')[0] == name]


class View(ABC):
    """A panel on the page of a lane.

    It shows the present state, so a slow browser skips items and never delays the line.

    Attributes
    ----------
    title, style : str
        Heading of the panel, and CSS of the view.
    columns : tuple of int
        Columns that the panel takes, of 2 on a tablet and of 12 on a desktop.
    period : float
        Period of updates in s; in a recorded shift all views have `FAST`, because the viewer
        waits.
    live, recorded : bool
        Whether a running lane and a recorded shift have this view.
    """

    title: ClassVar[str]
    style: ClassVar[str] = ''
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
        """Show the present state if it has changed."""
        state = self._state()
        if state != self._shown:
            self._shown = state
            self._show()

    def _state(self) -> object:
        """Return a value that changes whenever the view must be updated."""
        return self.lane.version, self.look.chosen, self.look.only_faults

    @abstractmethod
    def _build(self) -> None:
        """Add the elements of the view to its panel."""

    @abstractmethod
    def _show(self) -> None:
        """Show the present state in these elements."""


class FigureView(View):
    """View with one figure over many items; `label` is its name for screen readers."""

    label: ClassVar[str]

    @classmethod
    def figure(cls, drawing: Drawing) -> str:
        """Return the figure as JSON; it is drawn again for a new item, product or batch."""
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
