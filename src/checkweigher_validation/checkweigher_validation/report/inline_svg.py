# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures as SVG elements in an HTML page, with the colours and the font of the page.

A figure is drawn in placeholder colours, which are replaced by CSS variables in the SVG element.
Therefore the same figure suits a light page, a dark page and print. Text in a figure can be
selected and searched.
"""

from collections.abc import Sequence
import io
from pathlib import Path
import re
from typing import Any

from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Placeholder colours, and the names of their CSS variables.
INK, MUTED, GRID, SURFACE, SHADE = (f'#0{number}0b0d' for number in range(1, 6))
_SERIES = re.compile('#f1e2([0-9a-f]{2})')
_VARIABLES = {INK: 'ink', MUTED: 'muted', GRID: 'grid', SURFACE: 'surface', SHADE: 'shade'}

# Path of the matplotlib style sheet of the reports, for `matplotlib.rc_context`.
STYLE = Path(__file__).with_name('report.mplstyle')

DASHED: Any = {'color': INK, 'lw': 1.2, 'ls': (0, (4, 2))}
DOTTED: Any = {'color': MUTED, 'lw': 0.9, 'ls': (0, (2, 2))}


def stand_in(number: int) -> str:
    """Return the placeholder colour of the series N = `number`, from 0 to 255.

    In the SVG element, the CSS variable ``var(--series-N)`` replaces this colour.
    """
    return f'#f1e2{number:02x}'


def new_figure(height: float, rows: int = 1, columns: int = 1, **more: Any) -> tuple[Figure, Any]:
    """Return a figure as wide as the page, and its panels.

    `height` is the height in inches. The panels are those that `Figure.subplots` returns for the
    arguments `rows` and `columns` and the keywords `more`.
    """
    figure = Figure(figsize=(9.6, height))
    return figure, figure.subplots(rows, columns, **more)


def label_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Label the rows of a diagram, and turn its vertical axis so that the first row is on top."""
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis='y', length=0, labelcolor=INK)
    axes.invert_yaxis()


def to_inline_svg(figure: Figure, name: str, description: str) -> Markup:
    """Return a figure as an SVG element for an HTML page.

    The caller must have selected the style sheet `STYLE` with `matplotlib.rc_context`. `name` is a
    prefix for all ids in the figure, and must be unique on the page. Screen readers speak the text
    `description`.
    """
    file = io.StringIO()
    # Omit the metadata, because it contains a date, which would make equal figures different.
    no_metadata = dict.fromkeys(('Creator', 'Date', 'Format', 'Type'))
    figure.savefig(file, format='svg', metadata=no_metadata)
    text = file.getvalue()
    # Remove width, height and font, because the page determines them.
    head, rest = text[text.index('<svg') :].split('>', 1)
    head = re.sub(r' (width|height)="[^"]*"', '', head)
    rest = re.sub(r'(font: [^;\"]*?[\d.]+px) [^;\"]*', r'\g<1> var(--font)', rest)
    rest = re.sub(r'(\bid="|xlink:href="#|url\(#)', rf'\g<1>{name}-', rest)
    for color, variable in _VARIABLES.items():
        rest = rest.replace(color, f'var(--{variable})')
    rest = _SERIES.sub(lambda found: f'var(--series-{int(found[1], 16)})', rest)
    return Markup(f'{head} role="img" aria-label="{escape(description)}">{rest}'.strip())
