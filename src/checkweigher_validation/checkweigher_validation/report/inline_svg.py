# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of the reports, as SVG within an HTML page that uses the colours of the page.

A figure is drawn in stand-in colours. In the finished SVG, these become CSS variables, so the same
figure suits a light page, a dark page and paper. Text stays text, in the font of the page.
"""

from collections.abc import Sequence
import io
from pathlib import Path
import re
from typing import Any

from markupsafe import escape
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Stand-ins and the CSS variables they become.
INK, MUTED, GRID, SURFACE, SHADE = (f'#0{number}0b0d' for number in range(1, 6))
_SERIES = re.compile('#f1e2([0-9a-f]{2})')
_VARIABLES = {INK: 'ink', MUTED: 'muted', GRID: 'grid', SURFACE: 'surface', SHADE: 'shade'}

# Style of the figures, which are drawn and written within matplotlib.rc_context.
STYLE = Path(__file__).with_name('report.mplstyle')

# Lines of limits.
DASHED: Any = {'color': INK, 'lw': 1.2, 'ls': (0, (4, 2))}
DOTTED: Any = {'color': MUTED, 'lw': 0.9, 'ls': (0, (2, 2))}


def stand_in(number: int) -> str:
    """Return the stand-in colour of a series; it becomes the CSS variable ``--series-N``."""
    return f'#f1e2{number:02x}'


def new_figure(height: float, rows: int = 1, columns: int = 1, **more: Any) -> tuple[Figure, Any]:
    """Return a figure as wide as the page, of a height in inches, and its panels."""
    figure = Figure(figsize=(9.6, height))
    return figure, figure.subplots(rows, columns, **more)


def label_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Label the rows of a diagram, with the first row on top."""
    axes.set_yticks(range(len(labels)), labels)
    axes.tick_params(axis='y', length=0, labelcolor=INK)
    axes.invert_yaxis()


def to_inline_svg(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an SVG element for an HTML page; draw and convert it within `STYLE`.

    `name` is the prefix of all ids in the figure, which must be unique on the page. `description`
    is a text for readers who cannot see the figure.
    """
    file = io.StringIO()
    # The metadata would contain the names of programs and a date.
    no_metadata = dict.fromkeys(('Creator', 'Date', 'Format', 'Type'))
    figure.savefig(file, format='svg', metadata=no_metadata)
    text = file.getvalue()
    # The page determines the size and the font.
    head, rest = text[text.index('<svg') :].split('>', 1)
    head = re.sub(r' (width|height)="[^"]*"', '', head)
    rest = re.sub(r'(font: [^;\"]*?[\d.]+px) [^;\"]*', r'\g<1> var(--font)', rest)
    rest = re.sub(r'(\bid="|xlink:href="#|url\(#)', rf'\g<1>{name}-', rest)
    for color, variable in _VARIABLES.items():
        rest = rest.replace(color, f'var(--{variable})')
    rest = _SERIES.sub(lambda found: f'var(--series-{int(found[1], 16)})', rest)
    return f'{head} role="img" aria-label="{escape(description)}">{rest}'.strip()
