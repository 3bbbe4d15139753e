# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the findings on faulty samples, clocks and photo-eyes."""

from dataclasses import replace

import numpy as np
import pytest

from checkweigher_core.health.findings import Finding, Level
from checkweigher_core.health.stream import EyeWatch, SampleWatch
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock

CELL = LoadCell(960.0, 1e6, 5000.0, -(2**23), 2**23 - 1, 7.2, 0.2)
START = 1_700_000_000 * NANOSECONDS
SIZE = 10
BLOCKS = 1920  # number of blocks in 20 s


def block(number, *, rate=CELL.sample_rate, value=0):
    first = number * SIZE
    stamp = START + round(first * NANOSECONDS / rate)
    return SampleBlock(stamp, first, np.full(SIZE, value, np.int32))


def arrival(number, rate=CELL.sample_rate):
    """Return the time in s at which the last sample of a block was taken."""
    return 100.0 + (number + 1) * SIZE / rate


def watched(
    numbers=range(BLOCKS), *, watch=None, delay=lambda number: 0.0, rate=CELL.sample_rate, value=0
):
    """Return the statistics of these blocks, and a time in s after the last block."""
    watch = watch or SampleWatch(CELL)
    for number in numbers:
        watch.add(arrival(number, rate) + delay(number), block(number, rate=rate, value=value))
    now = arrival(max(numbers), rate) + 0.01
    watch.look(now)
    return watch, now


def test_a_steady_stream_is_well():
    watch, now = watched()
    samples, clock = watch.finding(now, 20.0), watch.clock.finding(0.0)
    assert (samples.level, clock.level) == (Level.OK, Level.OK)
    assert samples.values['received_samples_per_s'] == pytest.approx(960.0, rel=1e-9)
    assert samples.values['received_blocks_per_s'] == pytest.approx(96.0, rel=1e-9)
    assert samples.values['sample_rate_by_stamps_hz'] == pytest.approx(960.0, rel=1e-6)
    assert samples.values['age_of_last_block_s'] == pytest.approx(0.01, abs=1e-9)
    assert clock.values['drift_ppm'] != clock.values['drift_ppm']  # NaN: 20 s are too short
    assert clock.values['stamps_behind_this_machine_s'] == pytest.approx(100.0 - 1.7e9, rel=1e-12)


def test_samples_that_stop_are_an_error_until_they_go_on():
    watch, now = watched()
    stopped = watch.finding(now + 3.0, 20.0)
    assert stopped.level == Level.ERROR
    assert stopped.text == 'no samples for 3.0 s'
    assert 'cable' in stopped.hint
    watch.add(now + 3.1, block(BLOCKS))
    watch.look(now + 3.2)
    assert watch.finding(now + 3.2, 23.0).level == Level.OK


def test_nothing_is_missed_before_the_line_had_time_to_start():
    watch = SampleWatch(CELL)
    assert watch.finding(4.0, 4.0).level == Level.OK
    assert watch.finding(6.0, 6.0).text == 'no samples have arrived'


def test_a_gap_is_warned_of_for_a_minute_and_counted_for_ever():
    watch, now = watched([n for n in range(BLOCKS) if n not in (500, 501, 1000)])
    finding = watch.finding(now, 20.0)
    assert (finding.level, finding.values['gaps']) == (Level.WARN, 2)
    assert finding.values['samples_lost'] == 3 * SIZE
    assert finding.text == '30 samples lost in 2 gaps in the last minute'
    watch, now = watched(range(BLOCKS, 5 * BLOCKS), watch=watch)
    finding = watch.finding(now, 100.0)
    assert (finding.level, finding.values['samples_lost']) == (Level.OK, 3 * SIZE)


def test_blocks_that_come_twice_or_late_are_no_gap():
    watch, now = watched([0, 1, 2, 2, 4, 3, 5])
    values = watch.finding(now, 20.0).values
    assert (values['blocks_doubled_or_late'], values['gaps']) == (2, 1)


def test_a_source_that_starts_again_is_told_apart_from_a_late_block():
    watch, _ = watched(range(100))
    for number in range(10):
        again = replace(block(number), stamp=block(number).stamp + 5 * NANOSECONDS)
        watch.add(arrival(480 + number), again)
    watch.look(arrival(490))
    finding = watch.finding(arrival(490), 20.0)
    assert (finding.level, finding.values['source_restarts']) == (Level.WARN, 1)
    assert finding.values['blocks_doubled_or_late'] == 0


def test_saturated_samples_are_counted():
    watch, now = watched(range(100), value=CELL.max_counts)
    finding = watch.finding(now, 20.0)
    assert (finding.level, finding.values['samples_saturated']) == (Level.WARN, 1000)
    assert 'wiring' in finding.hint


def test_a_rate_other_than_that_of_the_load_cell_info_is_warned_of():
    watch, now = watched(range(1000), rate=912.0)
    finding = watch.finding(now, 20.0)
    assert finding.level == Level.WARN
    assert finding.text.startswith('912.0 samples/s by their stamps')


@pytest.mark.parametrize(('ppm', 'level'), [(200, Level.OK), (-2000, Level.WARN)])
def test_drift_is_seen_through_jitter(ppm, level):
    late = np.random.default_rng(1).exponential(0.005, 5 * BLOCKS)
    late[::97] += 0.3
    watch, _ = watched(range(5 * BLOCKS), delay=lambda n: ppm * 1e-6 * n * SIZE / 960.0 + late[n])
    finding = watch.clock.finding(0.0)
    assert finding.values['drift_ppm'] == pytest.approx(ppm, abs=5.0)
    assert finding.level == level


def test_jitter_is_the_delay_that_95_percent_of_the_blocks_keep():
    late = np.random.default_rng(1).exponential(0.005, BLOCKS)
    watch, _ = watched(delay=lambda number: late[number])
    # 95 % of the values of an exponential distribution are below three times its mean.
    jitter = watch.clock.finding(0.0).values['jitter_of_arrival_ms']
    assert jitter == pytest.approx(15.0, rel=0.2)


def test_a_replay_at_another_rate_is_not_judged():
    watch = SampleWatch(CELL)
    for number in range(BLOCKS):
        watch.add(100.0 + number * SIZE / 960.0 / 4, block(number))
    watch.look(106.0)
    finding = watch.clock.finding(0.0)
    assert finding.level == Level.OK
    assert finding.values['pace_of_stamps'] == pytest.approx(4.0, rel=1e-6)
    assert '4.00 times real time' in finding.text


def test_a_driver_that_catches_up_after_a_halt_is_no_replay():
    halt = 3000

    def delay(number):  # 5 s after the halt, then 0.4 s less with each second
        return 5.0 - 0.4 * (number - halt) * SIZE / CELL.sample_rate if number >= halt else 0.0

    watch, _ = watched(range(2 * BLOCKS), delay=delay)
    finding = watch.clock.finding(0.0)
    assert finding.values['pace_of_stamps'] == pytest.approx(1.0, abs=0.01)
    assert finding.level == Level.WARN
    assert finding.text.startswith('5 % of the blocks are at least')


@pytest.mark.parametrize(
    ('offset', 'level'), [(0.01, Level.OK), (0.25, Level.WARN), (-0.25, Level.WARN)]
)
def test_eyes_on_another_clock_than_the_samples_are_found(offset, level):
    watch, _ = watched()
    for second in range(5, 20):
        stamp = START + second * NANOSECONDS
        watch.clock.add_edge(100.0 + second + offset, EyeEdge(stamp, Eye.INFEED, True))
        watch.add(120.0, replace(block(BLOCKS), counts=np.zeros(0, np.int32)))
    watch.look(120.1)
    finding = watch.clock.finding(0.0)
    assert finding.values['edges_behind_samples_ms'] == pytest.approx(1e3 * offset, abs=0.1)
    assert finding.level == level


def test_an_eye_that_is_blind_or_stays_blocked_is_found():
    eyes = EyeWatch()
    for second in range(6):
        for blocked in (True, False):
            eyes.add(second + 0.1 * (not blocked), EyeEdge(0, Eye.INFEED, blocked))
    eyes.look(6.0)
    finding = eyes.finding(6.0)
    assert finding.level == Level.ERROR
    assert 'outfeed eye' in finding.hint
    for blocked in (False, True):
        eyes.add(7.0, EyeEdge(0, Eye.OUTFEED, blocked))
    eyes.look(16.0)
    assert eyes.finding(16.0).level == Level.OK
    assert eyes.finding(20.0).text == 'the outfeed eye has been blocked for 13 s'
    eyes.add(21.0, EyeEdge(0, Eye.OUTFEED, False))
    eyes.look(21.0)
    assert eyes.finding(21.0).level == Level.OK


def switched(infeed: list[float], outfeed: list[float]) -> Finding:
    """Return the finding after edges at these times in s; each eye is blocked by its first edge."""
    eyes = EyeWatch()
    edges = [
        (time, eye, number % 2 == 0)
        for eye, times in ((Eye.INFEED, infeed), (Eye.OUTFEED, outfeed))
        for number, time in enumerate(times)
    ]
    for time, eye, blocked in sorted(edges):
        eyes.add(time, EyeEdge(round(time * NANOSECONDS), eye, blocked))
    return eyes.finding(20.0)


def of_products(*edges: float, count: int = 20) -> list[float]:
    """Return times in s at which an eye switches, for products that come once a second."""
    return [second + edge for second in range(count) for edge in edges]


USUAL = of_products(0.0, 0.2)  # a product blocks an eye for 0.2 s
LATER = of_products(0.25, 0.45)


@pytest.mark.parametrize(
    'outfeed',
    [
        of_products(0.25, 0.27, 0.29, 0.45),  # switches three times as a product comes
        of_products(0.25, 0.27, 0.29, 0.44, 0.45, 0.46),
        [*LATER[:20], *of_products(10.25, 10.27, 10.29, 10.44, 10.45, 10.46, count=10)],
    ],
)
def test_a_dirty_eye_switches_again_sooner_than_products_can(outfeed: list[float]):
    finding = switched(USUAL, outfeed)
    text = f'the outfeed eye has switched {len(outfeed)} times in the last minute, but the infeed'
    assert (finding.level, finding.text) == (Level.WARN, f'{text} eye 40 times')
    assert finding.hint.startswith('clean the outfeed eye')


@pytest.mark.parametrize(
    'infeed',
    [
        USUAL[:14] + USUAL[30:],  # dead for 8 s
        [time for time in USUAL if int(time) % 2],  # misses every second product
        [time for time in USUAL if int(time) % 5 < 2],  # misses three of five products
    ],
)
def test_an_eye_that_works_is_not_blamed_if_the_other_one_misses_products(infeed: list[float]):
    assert switched(infeed, LATER).level == Level.OK
    # The eye that works also sees short products, which the other one misses.
    short = [time - 0.16 * (time % 1 > 0.4) * (int(time) % 2) for time in LATER]
    assert switched([time for time in USUAL if int(time) % 2 == 0], short).level == Level.OK
