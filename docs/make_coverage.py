# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Picture and table of docs/accuracy.md: how often the 95 % intervals of `learned` hold.

Takes some minutes: python3 docs/make_coverage.py, after source setup/environment.
"""

from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
import numpy as np

from checkweigher_core.records import GRAMS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.errors import ConditionResult, coverage, same
from checkweigher_validation.accuracy.evaluating import PassSet, evaluate_sets
from checkweigher_validation.accuracy.passes import SpeedGroup, whole_passes
from checkweigher_validation.accuracy.tables import LEVELS, METRES_PER_MINUTE
from checkweigher_validation.protocol.machines_protocol import (
    MASSES,
    SPEEDS,
    MachinesProtocol,
    evaluate_machines,
    passes_cut_by,
)
from checkweigher_validation.tuning.stated_lag import unchecked
from checkweigher_validation.tuning.tuner import tune

Results = tuple[ConditionResult, ...]

PICTURE = Path(__file__).with_name('coverage.png')
MACHINES = (46311, 46312, 46313, 46314, 46315, 46316)
FURTHER = 60  # passes for the attainable accuracy, which the picture does not show
TRAININGS = {'20 passes of 164.5 g': (20, (0.1645,)), '120 passes of five masses': (120, MASSES)}

# Training with one mass, and test with other masses in kg, on other machines.
ONE_MASS = (0.15,)
OTHER_MASSES = (0.05, 0.075, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5)
PASSES_OF_EACH = 12  # number of test passes of each mass
OTHER_MACHINES = (14521, 15411, 50759, 62757, 75312, 77919, 85854, 97377)
# Range of trained masses with which no variance is added.
UNLIMITED = {'lightest_mass': (0.0,), 'heaviest_mass': (1e3,)}


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


def extrapolated(machine: int, count: int) -> tuple[Results, Results]:
    """Train a machine with `count` passes of one mass, and weigh other masses.

    Returns the results without and with the variance that is added beyond the trained mass.
    """
    base = LineParameters()
    cut = partial(passes_cut_by, machine, cuts=(unchecked(base.segmenter),))
    groups = [SpeedGroup(v, whole_passes(*cut(v, ONE_MASS, count, 0))) for v in SPEEDS]
    line = tune(groups, ['learned'], base, n_jobs=1)['learned'].parameters
    unlimited = {f'identifier.learned.{name}': each for name, each in UNLIMITED.items()}
    tests = (cut(v, OTHER_MASSES, PASSES_OF_EACH * len(OTHER_MASSES), 1) for v in SPEEDS)
    sets = [PassSet(v, 'test', *each) for v, each in zip(SPEEDS, tests, strict=True)]
    lines = line.with_values(unlimited), line
    without, added = (evaluate_sets(sets, [each], n_jobs=1) for each in lines)
    return without, added


def print_extrapolated(count: int) -> None:
    """Print coverage and mean standard deviation without and with the variance, and rms error."""
    pairs = [extrapolated(machine, count) for machine in OTHER_MACHINES]
    without, added = (list(chain.from_iterable(each)) for each in zip(*pairs, strict=True))
    print(f'{count} passes of {GRAMS * ONE_MASS[0]:g} g: without, with, rms error')
    for mass in OTHER_MASSES:
        cells = [[one for one in each if same(one.mass, mass)] for each in (without, added)]
        stated = [GRAMS * np.mean(np.concatenate([one.std_devs for one in c])) for c in cells]
        shares = [100 * coverage(each, LEVELS[-1]) for each in cells]
        errors = GRAMS * np.sqrt(np.mean(np.concatenate([one.errors for one in cells[0]]) ** 2))
        columns = [f'{a:.0f} % {b:.3f} g' for a, b in zip(shares, stated, strict=True)]
        print(f'{GRAMS * mass:g} g', *columns, f'{errors:.3f} g', sep=' | ')


def main() -> None:
    """Draw the picture, a panel for each training, and print the table."""
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
    for count in (20, 60):
        print_extrapolated(count)


if __name__ == '__main__':
    main()
