# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated filler, and a line that closes the loop from the scale to it."""

import numpy as np
import pytest

from checkweigher_core.records import Reference
from checkweigher_production.filler_feedback import FillerParameters
from checkweigher_production.recipes import Product
from checkweigher_recording.simulation.closed_loop import with_feedback
from checkweigher_recording.simulation.filler import Filler
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters


def test_a_correction_reaches_the_scale_after_the_products_on_their_way():
    filler = Filler((0.1, 0.2), drift=0.001, spread=0.0, delay=2, random=np.random.default_rng(1))
    assert [filler.next_mass() for _ in range(3)] == pytest.approx([0.1, 0.201, 0.102])
    filler.correction = 0.01
    # Two were filled before it: the fourth and the fifth.
    assert [filler.next_mass() for _ in range(4)] == pytest.approx([0.203, 0.104, 0.215, 0.116])


def test_the_spread_is_that_of_the_parameter():
    filler = Filler((0.1,), 0.0, spread=0.002, delay=0, random=np.random.default_rng(1))
    masses = [filler.next_mass() for _ in range(4000)]
    assert np.std(masses) == pytest.approx(0.002, rel=0.05)
    assert np.mean(masses) == pytest.approx(0.1, abs=4 * 0.002 / 4000**0.5)


def test_a_line_with_feedback_keeps_the_masses_at_the_target():
    """A drift of 0.1 g a product: after 80 products 8 g without the feedback."""
    known = SimulationParameters(
        masses=(0.15,), count=80, profile='quiet', filler_drift=1e-4, filler_delay=3
    )
    filler = FillerParameters(subgroup=4, delay=6, gain=0.8, max_correction=0.02)
    product = Product('tins', nominal=0.15, filler=filler)
    open_loop, closed = (
        [event.mass for event in events if isinstance(event, Reference)]
        for events in (Simulation(known), with_feedback(Simulation(known), product))
    )
    assert open_loop == pytest.approx([0.15 + 1e-4 * number for number in range(80)])
    assert closed[:7] == open_loop[:7]
    # It lags by drift times (subgroup + delay) / gain, about 1.3 g, and swings about that.
    assert np.mean(closed[40:]) == pytest.approx(0.1513, abs=0.0007)
    assert max(closed) < 0.1525
