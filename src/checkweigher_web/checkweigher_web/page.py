# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of a lane, which shows its views and keeps them up to date."""

from functools import partial

from nicegui import ui

from checkweigher_web.charts import DENOISED
from checkweigher_web.elements import STYLE, panel
from checkweigher_web.views.registry import VIEWS
from checkweigher_web.views.view import FAST, SLOW, Look, View


def show_lane(look: Look) -> None:
    """Show the views of a lane to one viewer, and keep them up to date."""
    ui.add_css(STYLE)
    ui.colors(primary=DENOISED)
    live = look.board is not None
    with ui.element('main').classes('board'):
        views = [
            _build(name, kind, look)
            for name, kind in VIEWS.items()
            if (kind.live if live else kind.recorded)
        ]
    for period in (FAST, SLOW):
        due = [view for view in views if view.period == period]
        ui.timer(period if live else FAST, partial(_update, due))


def _build(name: str, kind: type[View], look: Look) -> View:
    tablet, desk = kind.columns
    with panel(kind.title, name).style(f'--tablet: {tablet}; --desk: {desk}'):
        return kind(look)


def _update(views: list[View]) -> None:
    for view in views:
        view.update()
