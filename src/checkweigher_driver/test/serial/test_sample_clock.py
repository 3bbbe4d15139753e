# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stamps from a fitted clock against the simulated truth: drift, jitter, stalls, steps, losses."""

from dataclasses import replace
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_core.records import NANOSECONDS, SampleBlock
from checkweigher_driver.serial.blocks import BlockMaker
from checkweigher_driver.serial.decoder import Decoded
from checkweigher_driver.serial.reads import Read
from checkweigher_driver.serial.sample_clock import SampleClock
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_recording.bags.reading import read_bag

BAG = Path(__file__).parents[4] / 'bags/paper_60'
RATE = 960.0
START = 1_700_000_000_000_000_000
MS = 1_000_000


class Device:
    """Samples taken at a rate that is off by `drift`, and when the host reads them."""

    def __init__(self, drift, seed=1):
        self.period = NANOSECONDS / RATE * (1 + drift)
        self.random = np.random.default_rng(seed)

    def time(self, index):
        return START + round(index * self.period)

    def blocks(self, duration, jitter=5 * MS, size=10, stall=None):
        """Yield reads of whole blocks, late by 0..jitter; during `stall` the host reads none."""
        last = 0
        for first in range(0, round(duration * RATE), size):
            host = self.time(first + size - 1) + round(self.random.uniform(0, jitter))
            if stall and stall[0] <= first / RATE < stall[1]:
                host = max(host, self.time(round(stall[1] * RATE)))
            last = max(last, host)
            yield first, size, last

    def bursts(self, duration, every=16 * MS):
        """Yield what a USB adapter hands over every 16 ms: all that has come by then."""
        index, host = 0, START + 3 * MS
        while index < duration * RATE:
            count = int((host - START) // self.period) + 1 - index
            yield index, count, host + round(self.random.exponential(0.3 * MS))
            index, host = index + count, host + every


def errors(reads, true_time, clock=None):
    """Return time of signal (s) and error of the stamps (samples) wherever they may be used."""
    clock = clock or SampleClock(RATE)
    found = []
    for first, count, host in reads:
        clock.add(first, count, host)
        if clock.settled:
            found += [
                (index / RATE, (clock.stamp(index) - true_time(index)) * RATE / NANOSECONDS)
                for index in (first, first + count - 1)
            ]
    return clock, np.array(found)


@pytest.mark.parametrize(
    ('drift', 'duration', 'size'), [(200e-6, 600, 20), (0.01, 80, 10), (-0.01, 80, 10)]
)
def test_stamps_hold_to_one_sample_over_minutes_of_drift_and_jitter(drift, duration, size):
    device = Device(drift)
    clock, found = errors(device.blocks(duration, size=size), device.time)

    assert found[0, 0] < 1.1
    assert np.abs(found[:, 1]).max() < 1
    # A minute of reads at 5 ms of jitter leaves less than a tenth of a sample.
    assert np.abs(found[found[:, 0] > 60, 1]).max() < 0.1
    figures = clock.figures()
    assert figures['clock drift ppm'] == pytest.approx(1e6 * drift, abs=2)
    assert figures['read jitter ms'] == pytest.approx(2.5, abs=0.5)  # mean of 0..5 ms
    assert figures['clock steps'] == figures['clock shifts'] == 0


@pytest.mark.parametrize('drift', [-200e-6, -0.01])
def test_stamps_hold_to_one_sample_with_the_bursts_of_a_usb_adapter(drift):
    device = Device(drift, seed=2)
    _, found = errors(device.bursts(120), device.time)

    assert np.abs(found[:, 1]).max() < 1
    assert np.abs(found[found[:, 0] > 60, 1]).max() < 0.2


def test_a_host_that_stalls_for_a_second_changes_no_stamp():
    device = Device(200e-6, seed=3)
    clock, found = errors(device.blocks(60, stall=(30.0, 31.0)), device.time)

    assert np.abs(found[:, 1]).max() < 1
    assert clock.figures()['clock steps'] == clock.figures()['clock shifts'] == 0
    # While reads are late beyond doubt the clock does not claim to know.
    assert not np.any((found[:, 0] > 30.1) & (found[:, 0] < 30.9))


@pytest.mark.parametrize('step', [3.6e12, 1e9, 50e6, -50e6, -1e9, -3.6e12])
def test_a_step_of_the_host_clock_is_followed_and_counted(step):
    device = Device(100e-6, seed=4)
    at = round(30 * RATE)

    def true_time(index):
        return device.time(index) + (round(step) if index >= at else 0)

    reads = ((i, n, host + (round(step) if i >= at else 0)) for i, n, host in device.blocks(60))
    clock, found = errors(reads, true_time)

    assert clock.figures()['clock steps'] == 1
    assert np.abs(found[:, 1]).max() < 1
    assert found[found[:, 0] > 30, 0].min() == pytest.approx(31, abs=0.2)


@pytest.mark.parametrize('step', [8e6, -8e6])
def test_a_small_step_is_followed_without_a_jump(step):
    device = Device(100e-6, seed=5)
    at = round(30 * RATE)
    clock = SampleClock(RATE)
    stamps = []
    for first, count, host in device.blocks(60):
        clock.add(first, count, host + (round(step) if first >= at else 0))
        stamps += [clock.stamp(first), clock.stamp(first + count - 1)]

    assert clock.figures()['clock shifts'] == 1
    assert stamps == sorted(stamps)
    last = round(60 * RATE) - 1
    assert stamps[-1] == pytest.approx(device.time(last) + step, abs=NANOSECONDS / RATE)


def test_samples_that_were_lost_unnoticed_are_noticed_by_the_clock():
    device = Device(100e-6, seed=6)
    at, lost = round(30 * RATE), 100
    reads = [(i, n, host) for i, n, host in device.blocks(60) if i < at]
    reads += [(i - lost, n, host) for i, n, host in device.blocks(60) if i >= at + lost]
    clock, found = errors(reads, lambda i: device.time(i if i < at else i + lost))

    assert clock.figures()['clock steps'] == 1
    assert np.abs(found[:, 1]).max() < 1


def test_the_latency_is_taken_off():
    late, plain = SampleClock(RATE, latency=0.012), SampleClock(RATE)
    for clock in (late, plain):
        clock.add(0, 10, START)
    assert plain.stamp(5) - late.stamp(5) == 12 * MS


@settings(max_examples=30)
@given(
    lateness=st.lists(st.floats(0, 5e6), min_size=150, max_size=300),
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=10),
    drift=st.floats(-0.02, 0.02),
)
def test_stamps_grow_with_the_index_for_any_reads(lateness, sizes, drift):
    device = Device(drift)
    clock = SampleClock(RATE)
    index, last = 0, START - NANOSECONDS
    for number, late in enumerate(lateness):
        size = sizes[number % len(sizes)]
        clock.add(index, size, device.time(index + size - 1) + round(late))
        assert last < clock.stamp(index) <= clock.stamp(index + size - 1)
        last = clock.stamp(index + size - 1)
        index += size


def test_windows_and_masses_of_a_bag_hold_to_one_sample_at_200_ppm_and_5_ms():
    recording = read_bag(BAG)
    device = Device(200e-6, seed=8)
    begin = recording.blocks[0].stamp
    counts = np.concatenate([block.counts for block in recording.blocks])
    edges = [
        replace(edge, stamp=START + round((edge.stamp - begin) * (1 + 200e-6)))
        for edge in recording.edges
    ]
    maker, blocks = BlockMaker(RATE, latency=0.0, limits=(-(2**23), 2**23 - 1)), []
    for first, size, host in device.blocks(len(counts) / RATE):
        read = counts[first : first + size]
        values = Decoded(read, np.zeros(len(read), bool), np.zeros(len(read), np.int64))
        blocks += maker.blocks(Read(values, host, 0))
    true_blocks = [
        SampleBlock(device.time(block.first_index), block.first_index, block.counts)
        for block in recording.blocks
    ]
    assert sum(len(block.counts) for block in blocks) == len(counts)

    def weighed(blocks):
        events = sorted([*blocks, *edges], key=lambda event: event.stamp)
        line = WeighingLine(recording.load_cell, LineParameters())
        found = list(line.weigh_all(events))
        assert all(each.estimate.weighed for each in found)
        return [each.window for each in found], np.array([each.estimate.mass for each in found])

    # What one sample can do to a mass: all samples shifted by one against the edges.
    period = round(NANOSECONDS / RATE)
    (_, before), (exact, masses), (_, after) = (
        weighed([replace(b, stamp=b.stamp + by) for b in true_blocks])
        for by in (-period, 0, period)
    )
    fitted, found = weighed(blocks)
    assert len(exact) == len(fitted) == 25
    for one, other in zip(exact, fitted, strict=True):
        assert not one.reasons
        assert not other.reasons
        for end in ('window_begin', 'window_end'):
            positions = [w.first_index + getattr(w, end) for w in (one, other)]
            assert abs(positions[0] - positions[1]) <= 1
    worst = np.abs([before - masses, after - masses]).max()
    assert np.abs(found - masses).max() <= worst < 1e-3
