# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile bags: one short line, or the right masses, within 1 GB of memory and at once."""

from collections import Counter
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path
import random
import shutil
import time

from hostile_bags import MCAP, SQLITE, Make, as_sqlite
from lines import simulated
import pytest

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.printable import one_line
from checkweigher_dsp.records import Decision
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.recovery import recover_bag
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.whole_file import OutputError
from checkweigher_validation.accuracy.results import ItemResult, weigh

PARAMETERS = LineParameters().with_estimator('mean')
MOST_MEMORY = 1000  # MB
LONGEST = 60.0  # s of processor time, for what unpacks to gigabytes
SAME = 5_000_000  # ns, by which t1 of the same item may differ
WITHIN = 4.0  # standard deviations that the line states


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a small bag in both kinds of storage."""
    line = simulated(count=3, speed=1.5, spacing=0.5, lead_in=0.6, run_out=0.3)
    folder = tmp_path_factory.mktemp('whole')
    write_bag(folder / 'mcap', line.load_cell, line)
    return {'mcap': folder / 'mcap', 'sqlite': as_sqlite(folder / 'mcap', folder / 'sqlite')}


def results(path: Path) -> list[ItemResult]:
    return list(weigh(read_bag(path), PARAMETERS))


def peak() -> int:
    """Return the largest memory of this process since the last reset, MB."""
    text = Path('/proc/self/status').read_text()
    return int(text.split('VmHWM:')[1].split()[0]) // 1000


def reset_peak() -> None:
    Path('/proc/self/clear_refs').write_text('5')


def escaped(found: list[ItemResult], whole: list[ItemResult]) -> str:
    """Return which item got a wrong mass or was lost, empty if none."""
    if len(found) < len(whole):
        return f'{len(whole) - len(found)} items are missing'
    for item in found:
        if item.verdict.decision is Decision.FAULT:
            continue
        true = [w for w in whole if abs((w.estimate.t1 or 0) - (item.estimate.t1 or 0)) < SAME]
        if not true:
            return f'an item that never was at {item.estimate.t1}'
        (one,) = true
        off = abs(item.estimate.mass - one.estimate.mass)
        if not off <= WITHIN * one.estimate.std_dev:
            return f'{1000 * off:.3f} g off, {off / one.estimate.std_dev:.1f} standard deviations'
    return ''


def outcome(path: Path, whole: list[ItemResult]) -> str:
    """Read a bag and say what came of it."""
    try:
        found = results(path)
    except BagError as error:
        refusal = str(error)
    else:
        refusal = ''
    if refusal:
        assert one_line(refusal).isprintable()
        assert len(one_line(refusal)) < 1000
        return 'refused'
    return f'ESCAPED: {wrong}' if (wrong := escaped(found, whole)) else 'right'


def campaign(
    kinds: dict[str, Make], good: Path, folder: Path, count: int, name: str
) -> dict[str, str]:
    """Read so many hostile bags, print the counts, and return what did not hold."""
    whole = results(good)
    outcomes: Counter[str] = Counter()
    bad: dict[str, str] = {}
    largest = 0
    for number, kind in enumerate(islice(cycle(kinds), count)):
        copy = shutil.copytree(good, folder / 'bag')
        path = kinds[kind](copy, random.Random(f'{kind} {number}'))
        reset_peak()
        began = time.process_time()
        found = outcome(path, whole)
        with suppress(BagError, OutputError):
            recover_bag(path, folder / 'recovered')
        took, memory = time.process_time() - began, peak()
        shutil.rmtree(folder / 'recovered', ignore_errors=True)
        largest = max(largest, memory)
        outcomes[found.partition(':')[0]] += 1
        if found not in ('refused', 'right') or memory > MOST_MEMORY or took > LONGEST:
            bad[f'{kind} {number}'] = f'{found}, {memory} MB, {took:.1f} s'
        shutil.rmtree(copy)
    print(f'\n{name}: {count} tried, {dict(outcomes)}, largest memory {largest} MB')
    return bad


def test_hostile_mcap_bags(bags: dict[str, Path], tmp_path: Path):
    assert not campaign(MCAP, bags['mcap'], tmp_path, len(MCAP), 'MCAP')


def test_hostile_sqlite_bags(bags: dict[str, Path], tmp_path: Path):
    assert not campaign(SQLITE, bags['sqlite'], tmp_path, 30, 'SQLite')


@pytest.mark.soak
def test_many_hostile_mcap_bags(bags: dict[str, Path], tmp_path: Path):
    assert not campaign(MCAP, bags['mcap'], tmp_path, 300, 'MCAP')


@pytest.mark.soak
def test_many_hostile_sqlite_bags(bags: dict[str, Path], tmp_path: Path):
    assert not campaign(SQLITE, bags['sqlite'], tmp_path, 300, 'SQLite')
