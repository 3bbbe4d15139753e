# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Memory of `weigh` and `simulate`, which does not grow with the length of a bag."""

from collections.abc import Iterator
import os
from pathlib import Path
import subprocess
import time

import numpy as np
from processes import resident_memory
import pytest
from running import PATIENCE, start_command

from checkweigher_core.recording import Event, canonical_order
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, Reference, SampleBlock
from checkweigher_recording.bags.writing import write_bag

HOURS = float(os.environ.get('CHECKWEIGHER_HOURS', '2'))  # of the soak test
RATE, SIZE = 20_000, 5_000  # Hz and samples of a block: 80 kB of samples a second
START = 1_700_000_000 * NANOSECONDS
GROWTH = 12_000  # kB that two runs may differ by


def noisy_line(seconds: int) -> Iterator[Event]:
    """Yield a line with one product per second and a noisy belt."""
    noise = np.random.default_rng(1).integers(-100, 100, SIZE + 997, dtype=np.int32)
    for number in range(seconds * RATE // SIZE):
        begin = START + number * SIZE * NANOSECONDS // RATE
        if number * SIZE % RATE == 0 and number:
            for late, eye, blocked in ((0, 0, True), (1, 0, False), (2, 1, True), (3, 1, False)):
                yield EyeEdge(begin + late * NANOSECONDS // 10, Eye(eye), blocked)
            yield Reference(begin, 0.1)
        yield SampleBlock(begin, number * SIZE, noise[number % 997 :][:SIZE])


def curve(*words: object, every: float = 0.05) -> list[int]:
    """Return the memory of a command in kB at several times, and its maximum as the last value."""
    process = start_command(*words, stdout=subprocess.DEVNULL, stderr=None)
    found = [0]
    most = 0
    while process.poll() is None:
        try:
            found.append(resident_memory(process.pid))
            most = max(most, resident_memory(process.pid, 'VmHWM'))
        except (KeyError, OSError, ProcessLookupError):  # it has just ended
            break
        time.sleep(every)
    assert process.wait(PATIENCE) == 0
    return [*found, most]


def test_weighing_a_bag_of_four_times_the_length_takes_no_more_memory(tmp_path: Path):
    cell = LoadCell(float(RATE), 5e5, 0.0, -(2**23), 2**23 - 1, 7.2, 0.2)
    most = []
    for seconds in (300, 1200):  # both long enough to fill the buffers of reader and stages
        bag = tmp_path / f'bag{seconds}'
        events = sorted(noisy_line(seconds), key=canonical_order)
        write_bag(bag, cell, events)
        words = ('weigh', bag, '--estimator', 'mean', '--csv', tmp_path / f'{seconds}.csv')
        most.append(curve(*words)[-1])
        assert len((tmp_path / f'{seconds}.csv').read_text().splitlines()) == seconds
    # All its samples would take 72 MB more.
    print(most)
    assert most[1] < most[0] + GROWTH


@pytest.mark.soak
def test_a_day_is_simulated_and_weighed_in_constant_memory(tmp_path: Path):
    count = round(HOURS * 3600 / 0.66)
    for words in (
        ('simulate', '--speed', 60, '--mass', 74.5, 134.5, '--count', count, '--output',
         tmp_path / 'day'),
        ('weigh', tmp_path / 'day', '--csv', tmp_path / 'day.csv'),
        ('weigh', tmp_path / 'day', '--output', tmp_path / 'results', '--jobs', 1),
    ):  # fmt: skip
        *found, most = curve(*words, every=1.0)
        tenths = [found[len(found) * part // 10] // 1000 for part in range(1, 10)]
        print(f'\n{words[0]}, {HOURS:g} h: {tenths} MB, {most // 1000} MB at most')
        half = len(found) // 2
        assert max(found[half:]) < max(found[:half]) + GROWTH
    assert len((tmp_path / 'day.csv').read_text().splitlines()) == count + 1
