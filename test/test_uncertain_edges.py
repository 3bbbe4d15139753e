"""How much of the uncertainty of polled photo-eyes goes into the mass, for each estimator."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from running import BAGS

from checkweigher_driver.bag_reading import read_bag
from checkweigher_driver.recording import Recording
from checkweigher_dsp.line import LineParameters, WeighingLine
from checkweigher_dsp.records import NANOSECONDS, Eye, EyeEdge

UNCERTAINTY = 1.3e-3  # s, of an eye that is polled every 2 ms
ROUNDS = 4
# What the table of docs/hardware_io.md shows: g, root mean square, at most.
MOST = {'iswd_eksi': 0.4, 'gauss_markov': 0.1, 'aid': 0.05, 'aeksi': 0.05, 'hann': 0.05}

Shift = Callable[[EyeEdge], float]


def weighed(recording: Recording, estimator: str, shift: Shift) -> np.ndarray:
    """Return the masses in g where each edge is later by `shift` s."""
    line = WeighingLine(recording.load_cell, LineParameters().with_estimator(estimator))
    edges = [replace(e, stamp=e.stamp + round(NANOSECONDS * shift(e))) for e in recording.edges]
    events = sorted([*recording.blocks, *edges], key=lambda event: event.stamp)
    return np.array([1e3 * done.estimate.mass for event in events for done in line.add(event)])


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


def inwards(edge: EyeEdge) -> float:
    """Return by how much an edge moves if the window is to be surely that of t2..t3, s."""
    clears, blocks = (Eye.INFEED, False), (Eye.OUTFEED, True)
    return {clears: UNCERTAINTY, blocks: -UNCERTAINTY}.get((edge.eye, edge.blocked), 0.0)


@pytest.mark.soak
@pytest.mark.parametrize('estimator', MOST)
@pytest.mark.parametrize('bag', ['paper_60', 'paper_90'])
def test_what_polled_edges_do_to_a_mass(bag: str, estimator: str):
    recording, random = read_bag(BAGS / bag), np.random.default_rng(1)
    plain = weighed(recording, estimator, lambda edge: 0.0)
    true = np.array([1e3 * reference.mass for reference in recording.references])

    def doubt(edge: EyeEdge) -> float:
        return random.uniform(-UNCERTAINTY, UNCERTAINTY)

    def added(shift: Shift) -> float:
        rounds = [weighed(recording, estimator, shift) - plain for _ in range(ROUNDS)]
        return rms(np.concatenate(rounds))

    uncertain, shrunk = added(doubt), added(lambda edge: doubt(edge) + inwards(edge))
    print(
        f'\n{bag} {estimator}: {rms(plain - true):.3f} g off the truth; edges +-1.3 ms add '
        f'{uncertain:.3f} g, {shrunk:.3f} g with a window that is shorter by that at both ends'
    )
    assert uncertain < MOST[estimator]
    assert shrunk > 0.8 * uncertain  # that it would be no remedy
