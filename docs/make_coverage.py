# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The picture of docs/accuracy.md: how often the 95 % intervals of `learned` hold.

Takes some minutes: python3 docs/make_coverage.py, after source setup/environment.
"""

from itertools import chain
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.errors import coverage, same
from checkweigher_validation.accuracy.tables import LEVELS, METRES_PER_MINUTE
from checkweigher_validation.protocol.machines_protocol import (
    MASSES,
    SPEEDS,
    MachinesProtocol,
    evaluate_machines,
)

PICTURE = Path(__file__).with_name('coverage.png')
MACHINES = (46311, 46312, 46313, 46314, 46315, 46316)
FURTHER = 60  # passes for the attainable accuracy, which the picture does not show
TRAININGS = {'20 passes of 164.5 g': (20, (0.1645,)), '120 passes of five masses': (120, MASSES)}


def shares(passes: int, masses: tuple[float, ...]) -> Any:
    """Return the share of test passes within the intervals in %, (speeds, masses)."""
    protocol = MachinesProtocol(MACHINES, passes, masses, FURTHER)
    machines = evaluate_machines(protocol, ('learned',), LineParameters(), n_jobs=1)
    results = (each.tuned.select(estimator='learned', part='test') for each in machines)
    tested = list(chain.from_iterable(results))
    cells = [
        [one for one in tested if same(one.speed, speed) and same(one.mass, mass)]
        for speed in SPEEDS
        for mass in MASSES
    ]
    found = [100 * coverage(cell, LEVELS[-1]) for cell in cells]
    return np.reshape(found, (len(SPEEDS), len(MASSES)))


def main() -> None:
    """Draw the picture, a panel for each training."""
    figure = Figure(figsize=(8.4, 2.7), layout='constrained')
    for axes, (title, training) in zip(figure.subplots(1, 2), TRAININGS.items(), strict=True):
        found = shares(*training)
        print(title, found.round(1).tolist())
        axes.imshow(found, cmap='PuOr', vmin=85, vmax=105, aspect='auto')
        for (row, column), share in np.ndenumerate(found):
            axes.text(column, row, f'{share:.0f}', ha='center', va='center')
        axes.set_xticks(range(len(MASSES)), [f'{GRAMS * mass:g}' for mass in MASSES])
        axes.set_yticks(range(len(SPEEDS)), [f'{METRES_PER_MINUTE * v:g}' for v in SPEEDS])
        axes.set(title=f'{title}: errors in 95 %', xlabel='mass, g', ylabel='belt speed, m/min')
    figure.savefig(PICTURE, dpi=100, metadata={'Software': None})
    print(f'{PICTURE}: {PICTURE.stat().st_size / 1000:.0f} kB')


if __name__ == '__main__':
    main()
