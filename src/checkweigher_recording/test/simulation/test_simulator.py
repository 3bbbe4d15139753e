# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The simulated line against its physics and geometry."""

import gc
from itertools import dropwhile, islice, takewhile
import math
import tracemalloc

from lines import counts_of, grams_of
import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.recording import canonical_order
from checkweigher_core.records import Eye, EyeEdge, Reference, SampleBlock
from checkweigher_recording.simulation.operation import OperationParameters
from checkweigher_recording.simulation.simulator import (
    MAX_COUNTS,
    PROFILES,
    Simulation,
    SimulationParameters,
    simulate,
)

START = 1_700_000_000_000_000_000
RATE = 960.0


def _line(**values):
    return simulate(SimulationParameters(**values))


def _seconds(recording):
    return np.array([edge.stamp - START for edge in recording.edges]) / 1e9


@pytest.mark.parametrize('mass', [0.0745, 0.2545, 7.0])
def test_a_product_at_rest_reads_its_mass(mass):
    # A belt of 10 m at 1 m/s: the product is fully on for 9.9 s.
    recording = _line(profile='quiet', masses=(mass,), count=1, weigh_length=10.0, spacing=20.0)
    _, t2, t3, _ = _seconds(recording) * RATE
    # After 5 s of ring-down, e^(-xi w t) < 1e-8 even under 7 kg.
    plateau = grams_of(recording)[math.ceil(t2) + 4800 : math.ceil(t3)]

    # Electronic noise of 0.05 g and steps of 0.002 g remain.
    assert plateau.mean() == pytest.approx(
        1000 * mass, abs=5 * 0.05 / math.sqrt(len(plateau)) + 0.001
    )
    assert plateau.std() == pytest.approx(0.05, rel=0.05)


def test_edges_and_references_follow_from_the_geometry():
    # The quiet belt has no jitter.
    recording = _line(profile='quiet', speed=1.5, count=3, lead_in=1.25)
    times = [1.25 + 0.66 / 1.5 * item for item in range(3)]

    assert [(edge.eye, edge.blocked) for edge in recording.edges] == 3 * [
        (Eye.INFEED, True), (Eye.INFEED, False), (Eye.OUTFEED, True), (Eye.OUTFEED, False)
    ]  # fmt: skip
    expected = [t1 + way / 1.5 for t1 in times for way in (0.0, 0.1, 0.2, 0.3)]
    np.testing.assert_allclose(_seconds(recording), expected, rtol=0, atol=2e-9)
    assert [entry.mass for entry in recording.references] == [0.0745, 0.1345, 0.1645]
    assert [entry.stamp for entry in recording.references] == [
        edge.stamp for edge in recording.edges if edge.eye is Eye.INFEED and edge.blocked
    ]


def test_samples_and_edges_have_the_same_clock():
    # In the mean over a pass a linear platform neither changes the area under the load, mass L / v,
    # nor its centre, except for the delay of its step response, 2 xi / w = 0.5 ms.
    recording = _line(profile='quiet', speed=0.5, masses=(0.2,), count=1)
    t1, _, _, t4 = _seconds(recording) * RATE
    begin, end = math.floor(t1) - 100, math.ceil(t4) + 400
    grams = grams_of(recording)[begin:end]
    index = np.arange(begin, end)

    noise = 5 * 0.05 * math.sqrt(len(grams)) / RATE
    assert grams.sum() / RATE == pytest.approx(200.0 * 0.2 / 0.5, abs=noise + 0.01)
    centre = (grams * index).sum() / grams.sum()
    delay = (centre - (t1 + t4) / 2) / RATE
    # Half a sample is 0.5 ms, half an integration step 0.07 ms.
    assert delay == pytest.approx(2 * 0.06 / (2 * math.pi * 38), abs=0.1e-3)


def test_samples_are_evenly_stamped_and_numbered():
    recording = _line(count=2, samples_per_block=7)

    assert all(len(block.counts) == 7 for block in recording.blocks[:-1])
    assert counts_of(recording).dtype == np.int32
    for number, block in enumerate(recording.blocks):
        assert block.first_index == 7 * number
        assert block.stamp == START + round(block.first_index * 1e9 / RATE)


def test_samples_reach_from_lead_in_to_run_out():
    recording = _line(profile='quiet', count=1, lead_in=0.5, run_out=0.25)
    # t4 = 0.5 s + 0.3 m / 1 m/s
    assert len(counts_of(recording)) == math.ceil((0.5 + 0.3 + 0.25) * RATE) + 1


def test_equal_parameters_give_equal_counts_and_other_seeds_others():
    first, again, other = (_line(count=3, seed=seed) for seed in (5, 5, 6))

    np.testing.assert_array_equal(counts_of(first), counts_of(again))
    assert first.edges == again.edges
    assert not np.array_equal(counts_of(first)[:900], counts_of(other)[:900])
    assert first.edges != other.edges


def test_first_products_do_not_depend_on_how_many_follow():
    short = _line(count=2)
    long = _line(count=9)
    endless = list(islice(Simulation(SimulationParameters(count=0)), 150))
    # The long line's third product enters 0.66 m after the second.
    common = math.floor((long.edges[8].stamp - START) / 1e9 * RATE) - 1

    assert short.edges == long.edges[:8]
    edges = [event for event in endless if isinstance(event, EyeEdge)]
    assert edges == [edge for edge in long.edges if edge.stamp <= endless[-1].stamp]
    np.testing.assert_array_equal(counts_of(short)[:common], counts_of(long)[:common])


@pytest.mark.parametrize('spacing', [0.11, 0.25, 0.3, 0.66])
def test_events_come_in_canonical_order(spacing):
    parameters = SimulationParameters(count=30, spacing=spacing, speed=1.5)
    events = list(Simulation(parameters))

    assert events == sorted(events, key=canonical_order)
    assert sum(isinstance(event, EyeEdge) for event in events) == 120
    assert sum(isinstance(event, Reference) for event in events) == 30


def test_two_products_on_the_belt_add_up():
    # Every 0.2 m a product on a belt of 1.1 m between the eyes: always 5.5 of them, on average
    # over a spacing.
    recording = _line(profile='quiet', masses=(0.1,), count=60, spacing=0.2, weigh_length=1.1)
    middle = grams_of(recording)[round(6 * RATE) : round(10 * RATE)]

    assert middle.mean() == pytest.approx(550.0, abs=0.1)


def test_the_zero_drifts_as_told():
    recording = _line(profile='quiet', masses=(0.0,), count=1, lead_in=9.0, zero_drift=0.001)
    grams = grams_of(recording)
    slope, intercept = np.polyfit(np.arange(len(grams)) / RATE, grams, 1)

    assert slope == pytest.approx(1.0, abs=1e-3)
    assert intercept == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize('speed', [0.5, 1.0])
def test_roller_lines_are_at_the_rollers_turning_and_its_harmonics(speed):
    recording = _line(profile='roller', speed=speed, masses=(0.0,), count=1, lead_in=40.0)
    grams = grams_of(recording)[round(2 * RATE) : round(40 * RATE)]
    time = np.arange(len(grams)) / RATE
    turning = speed / (math.pi * 0.032)
    for order, level in enumerate(PROFILES['roller'].roller, start=1):
        frequency = order * turning
        line = 2 * abs(np.mean(grams * np.exp(-2j * math.pi * frequency * time)))
        beside = 2 * abs(np.mean(grams * np.exp(-2j * math.pi * (frequency + 0.5) * time)))
        # Amplitude of the force times the platform's gain.
        ratio = frequency / 38
        gain = 1 / math.hypot(1 - ratio**2, 2 * 0.06 * ratio)
        assert line == pytest.approx(level * speed * gain * 1000, rel=0.05)
        assert beside < 0.1 * line


def test_the_floor_shakes_between_4_and_12_hz():
    recording = _line(profile='floor', speed=0.01, masses=(0.0,), count=1, lead_in=60.0)
    grams = grams_of(recording)[960 : 60 * 960]
    power = abs(np.fft.rfft(grams) / len(grams)) ** 2 * 2
    frequency = np.fft.rfftfreq(len(grams), 1 / RATE)
    inside = power[(frequency > 3) & (frequency < 14)].sum()

    # The platform's gain in the band is between 1.01 and 1.11.
    assert math.sqrt(inside) == pytest.approx(PROFILES['floor'].floor * 1000 * 1.05, rel=0.1)
    assert power[(frequency > 0.2) & (frequency < 2)].sum() < 0.01 * inside


def test_readings_stop_at_the_converters_limits():
    recording = _line(count=1, masses=(3.0,), counts_per_kg=1e6, zero_counts=6e6)
    assert counts_of(recording).max() == MAX_COUNTS == recording.load_cell.max_counts == 2**23 - 1


def test_an_inverted_cell_counts_downwards():
    recording = _line(profile='quiet', count=1, masses=(0.2,), counts_per_kg=-5e5)
    assert counts_of(recording).min() < 1_250_000 - 99_000
    assert grams_of(recording).max() == pytest.approx(200, rel=0.2)


def test_a_long_line_needs_no_more_memory_than_a_short_one():
    events = iter(Simulation(SimulationParameters(count=0, speed=1.5)))

    def held(blocks):
        for _ in range(blocks):
            next(events)
        gc.collect()
        return tracemalloc.get_traced_memory()[0]

    tracemalloc.start()
    try:
        short, long = held(1000), held(6000)
    finally:
        tracemalloc.stop()
    # A second of the signal is held; the 57 s in between would be 220 kB. Caches of the libraries
    # may still grow by some tens of kB.
    assert long < short + 100_000


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'profile': 'worn'}, "simulator.profile: 'worn' is not one of paper, roller"),
        ({'masses': ()}, 'simulator.masses: is empty'),
        ({'masses': (-1.0,)}, r'simulator.masses: -1.0 is not in 0\.\.7\.2 kg'),
        ({'spacing': 0.1}, 'simulator.spacing: 0.1 m is not above product_length 0.1 m'),
        ({'speed': 0.0}, r'simulator.speed: 0.0 is not in 0\.01\.\.5 m/s'),
        ({'zero_drift': 0.1}, 'simulator.zero_drift'),
        ({'counts_per_kg': 0.0}, 'simulator.counts_per_kg: is 0'),
        ({'seed': -1}, 'simulator.seed'),
    ],
)
def test_what_cannot_be_simulated_is_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        SimulationParameters(**values)


def test_an_endless_line_has_no_recording():
    with pytest.raises(ParameterError, match=r'simulator\.count'):
        _line(count=0)


def operated(seconds, **values):
    """Return some seconds of an endless line, two seconds after an operator has set something."""
    line = Simulation(SimulationParameters(profile='quiet', count=0, masses=(0.1,)))
    events = iter(line)
    begin = next(events).stamp + 5 * 10**9
    while next(events).stamp < begin:
        pass
    line.operation = OperationParameters(**values)
    begin += 2 * 10**9
    after = dropwhile(lambda event: event.stamp < begin, events)
    end = begin + seconds * 10**9
    return line.load_cell, list(takewhile(lambda event: event.stamp < end, after))


def test_without_feed_nothing_passes_and_a_load_stands_on_the_belt():
    cell, events = operated(3, feed=False, load=0.2)
    assert all(isinstance(event, SampleBlock) for event in events)
    counts = np.concatenate([block.counts for block in events])
    load = (counts - cell.zero_counts) / cell.counts_per_kg
    assert load == pytest.approx(0.2, abs=1e-3)


def test_an_operator_sets_mass_and_belt_speed_of_a_line_that_runs():
    _, events = operated(5, mass=0.3, speed=1.5)
    assert {each.mass for each in events if isinstance(each, Reference)} == {0.3}
    edges = [each for each in events if isinstance(each, EyeEdge)]
    entered = [each.stamp for each in edges if each.eye == Eye.INFEED and each.blocked]
    assert np.diff(entered) / 1e9 == pytest.approx(0.66 / 1.5, rel=0.01)


def test_a_product_that_a_hand_puts_on_the_belt_passes_without_feed():
    _, events = operated(4, feed=False, put=2, put_mass=0.3)
    # One of them may have passed before the events that are looked at.
    assert {each.mass for each in events if isinstance(each, Reference)} <= {0.3}
    line = Simulation(SimulationParameters(count=0))
    events = iter(line)
    while next(events).stamp < START + 5 * 10**9:
        pass
    line.operation = OperationParameters(feed=False, put=2, put_mass=0.3)
    later = takewhile(lambda event: event.stamp < START + 12 * 10**9, events)
    masses = [each.mass for each in later if isinstance(each, Reference)]
    assert masses[-2:] == [0.3, 0.3]
    assert masses.count(0.3) == 2


def test_a_gap_is_the_free_belt_between_two_products():
    _, events = operated(5, gap=0.05, speed=0.5)
    edges = [each for each in events if isinstance(each, EyeEdge) and each.eye == Eye.INFEED]
    stamps = [each.stamp for each in edges[edges[0].blocked is False :]]
    clear = np.subtract(stamps[2::2], stamps[1:-1:2]) / 1e9
    assert clear == pytest.approx(0.05 / 0.5, rel=0.01)


def test_an_eye_is_displaced_dirty_or_dead():
    _, events = operated(5, infeed_place=-0.03, outfeed_dead=True)
    assert [each.stamp for each in events] == sorted(each.stamp for each in events)
    edges = [each for each in events if isinstance(each, EyeEdge)]
    assert {each.eye for each in edges} == {Eye.INFEED}
    entries = [each.stamp for each in events if isinstance(each, Reference)]
    early = [each.stamp for each in edges if each.blocked][-2]
    assert min(abs(stamp - early) for stamp in entries) / 1e9 == pytest.approx(0.03, rel=0.01)

    _, events = operated(3, infeed_dirty=True)
    edges = [each for each in events if isinstance(each, EyeEdge)]
    counts = [sum(each.eye == eye for each in edges) for eye in (Eye.INFEED, Eye.OUTFEED)]
    assert counts[0] / counts[1] == pytest.approx(7, rel=0.2)


def test_the_zero_is_shifted():
    cell, events = operated(2, feed=False, zero=0.02)
    counts = np.concatenate([block.counts for block in events])
    assert (counts.mean() - cell.zero_counts) / cell.counts_per_kg == pytest.approx(0.02, abs=1e-4)
