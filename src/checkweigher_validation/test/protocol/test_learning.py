# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learning from products of unknown mass on random machines, compared with tuning."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.identifier import Identifier
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.protocol.machines_protocol import MASSES, SPEEDS, passes_cut_by
from checkweigher_validation.tuning.stated_lag import unchecked
from checkweigher_validation.tuning.tuner import tune

BASE = LineParameters()
SEGMENTER = unchecked(BASE.segmenter)  # all weigh the same windows
MACHINES = (9021, 9022, 9023, 9024)


def scatter(estimates, masses):
    """Return the standard deviation in g, within each mass, of all items after the first 30."""
    errors = (np.array([each.mass for each in estimates]) - masses)[30:]
    own = [errors[masses[30:] == mass] for mass in np.unique(masses)]
    return 1e3 * float(np.sqrt(np.mean([np.var(each, ddof=1) for each in own])))


def passes(machine, speed, seed):
    found = passes_cut_by(machine, speed, MASSES, 120, seed, [SEGMENTER])[0]
    return tuple(each for each in found if each.whole)


@pytest.mark.soak
def test_after_thirty_items_the_scatter_is_near_that_of_a_tuned_machine():
    learning = replace(BASE.identifier, learn=True)
    frozen = replace(learning, learning=replace(learning.learning, most=30))
    table = []
    for machine in MACHINES:
        groups = [SpeedGroup(speed, passes(machine, speed, 0)) for speed in SPEEDS]
        tuned = tune(groups, ['learned'], BASE)['learned'].parameters.identifier
        for speed in SPEEDS:
            known = passes(machine, speed, 1)
            masses = np.array([each.mass for each in known])
            windows = Denoiser(BASE.denoise).denoise_all([each.window for each in known])
            best, *others = (
                scatter(Identifier(each).estimate_all(windows), masses)
                for each in (tuned, BASE.identifier, frozen, learning)
            )
            table.append([each / best for each in others])
            text = ', '.join(f'{each:.2f}' for each in table[-1])
            print(f'{machine} at {60 * speed:.0f} m/min: tuned {best:.3f} g; over it {text}')
    untrained, after_thirty, on = np.array(table).T
    for name, ratios in (('untrained', untrained), ('30 items', after_thirty), ('on', on)):
        print(f'{name}: mean {ratios.mean():.2f}, worst {ratios.max():.2f}')
    assert on.mean() < 1.25
    assert after_thirty.mean() < 1.5
    assert np.all(on < 1.1 * untrained)
