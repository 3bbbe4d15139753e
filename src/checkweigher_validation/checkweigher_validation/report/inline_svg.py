# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures as SVG that stands inside an HTML page and takes its colours.

A figure is drawn in stand-in colours. In the finished SVG these become CSS variables, so one figure
serves a light and a dark page and paper. Text stays text, in the font of the page.
"""

from html import escape
import io
import re
from typing import Any

from matplotlib.figure import Figure

# Stand-ins and the CSS variables they become.
INK, MUTED, GRID, SURFACE, SHADE = (f'#0{number}0b0d' for number in range(1, 6))
_SERIES = re.compile('#f1e2([0-9a-f]{2})')
_VARIABLES = {INK: 'ink', MUTED: 'muted', GRID: 'grid', SURFACE: 'surface', SHADE: 'shade'}

# The look of the report, for matplotlib.rc_context: figures are drawn and written within. Any:
# matplotlib's own type of it is a list of all names that there are.
STYLE: Any = {
    'axes.axisbelow': True,
    'axes.edgecolor': GRID,
    'axes.facecolor': 'none',
    'axes.grid': True,
    'axes.labelcolor': MUTED,
    'axes.labelsize': 9,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlecolor': INK,
    'axes.titlelocation': 'left',
    'axes.titlesize': 10,
    'figure.constrained_layout.use': True,
    'figure.facecolor': 'none',
    'font.size': 9,
    'grid.color': GRID,
    'grid.linewidth': 0.8,
    'legend.frameon': False,
    'legend.labelcolor': INK,
    'lines.linewidth': 1.4,
    'lines.solid_capstyle': 'round',
    'mathtext.default': 'regular',
    # Text as text; equal figures are equal files.
    'svg.fonttype': 'none',
    'svg.hashsalt': 'checkweigher',
    'text.color': INK,
    'xtick.color': GRID,
    'xtick.labelcolor': MUTED,
    'xtick.labelsize': 8.5,
    'ytick.color': GRID,
    'ytick.labelcolor': MUTED,
    'ytick.labelsize': 8.5,
}


def stand_in(number: int) -> str:
    """Return the stand-in colour of a series; it becomes the CSS variable ``--series-N``."""
    return f'#f1e2{number:02x}'


def to_inline_svg(figure: Figure, name: str, description: str) -> str:
    """Return a figure as an SVG element for an HTML page; call it within `STYLE`.

    Parameters
    ----------
    figure : Figure
        Drawn within `STYLE`.
    name : str
        Prefix of all ids within the figure, which have to be unique on the page.
    description : str
        Text for readers who cannot see the figure.
    """
    file = io.StringIO()
    # None of its metadata, and so none of the names in it.
    no_metadata = dict.fromkeys(('Creator', 'Date', 'Format', 'Type'))
    figure.savefig(file, format='svg', metadata=no_metadata)
    text = file.getvalue()
    # The size is up to the page; its font, too.
    head, rest = text[text.index('<svg') :].split('>', 1)
    head = re.sub(r' (width|height)="[^"]*"', '', head)
    rest = re.sub(r'(font: [^;\"]*?[\d.]+px) [^;\"]*', r'\g<1> var(--font)', rest)
    rest = re.sub(r'(\bid="|xlink:href="#|url\(#)', rf'\g<1>{name}-', rest)
    for color, variable in _VARIABLES.items():
        rest = rest.replace(color, f'var(--{variable})')
    rest = _SERIES.sub(lambda found: f'var(--series-{int(found[1], 16)})', rest)
    return f'{head} role="img" aria-label="{escape(description)}">{rest}'.strip()
