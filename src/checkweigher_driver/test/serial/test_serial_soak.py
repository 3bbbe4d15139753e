# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A minute on every serial line, and lines that are unplugged again and again."""

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
import time

import numpy as np
import pytest
from serial_device import number_of
from serial_line import LINES, RATE, Reader, SerialDevice, make

pytestmark = pytest.mark.soak

BREAKS = 20


@pytest.mark.parametrize('name', LINES)
def test_a_minute_at_1200_values_a_second_loses_nothing(name, tmp_path):
    kind, values, options = LINES[name]
    device = SerialDevice(tmp_path / 'port', '--rate', RATE, *options)
    reader = Reader(make(kind, tmp_path / 'port', **values))
    reader.wait_for_samples(1)
    cpu, begin = time.process_time(), time.monotonic()
    reader.wait_for_samples(60 * RATE, patience=90)
    cpu = (time.process_time() - cpu) / (time.monotonic() - begin)
    reader.close()
    device.end()

    figures = reader.source.figures()
    counts = np.concatenate([block.counts for block in reader.events])
    print(f'\n{name}: {len(counts)} values, {cpu:.1%} of a core, {figures}')
    sent = np.array([number_of(count) for count in counts.tolist()])
    np.testing.assert_array_equal(np.diff(sent) % 2**24, 1)
    assert figures['samples lost'] == figures['bad frames'] == figures['breaks'] == 0


def unplugged_again_and_again(name, link):
    """Return how long each break took to be noticed and each replug to bring samples, s."""
    kind, values, options = LINES[name]
    device = SerialDevice(link, '--rate', RATE, *options)
    reader = Reader(make(kind, link, **values))
    reader.wait_for_samples(100)
    noticed, back = [], []
    for number in range(BREAKS):
        device.tell('unplug')
        noticed.append(reader.wait_for(lambda: reader.source.trouble))
        time.sleep(0.1 * number)  # breaks of different lengths, not a wait for something
        device.tell('replug')
        back.append(reader.wait_for_samples(50))
    reader.close()
    device.end()
    assert reader.error is None
    assert reader.source.figures()['breaks'] >= BREAKS
    values_of = [number_of(count) for b in reader.events for count in b.counts.tolist()]
    assert all(after > before for before, after in pairwise(values_of))
    return noticed, back


def test_a_line_that_is_unplugged_again_and_again_comes_back_each_time(tmp_path):
    with ThreadPoolExecutor() as pool:
        results = list(
            pool.map(
                unplugged_again_and_again, LINES, [tmp_path / f'port{i}' for i in range(len(LINES))]
            )
        )
    for name, (noticed, back) in zip(LINES, results, strict=True):
        print(
            f'\n{name}: {len(noticed)} breaks, noticed after {np.median(noticed):.3f} s '
            f'(at most {max(noticed):.3f} s), samples {np.median(back):.2f} s after the replug '
            f'(at most {max(back):.2f} s)'
        )
