# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Impossible records in the middle of a line, and parameters at their limits."""

from collections import Counter
from collections.abc import Callable
from dataclasses import fields, replace
import math
import os
import random
import re
from typing import Any

from lines import simulated
import numpy as np
from processes import resident_memory
import pytest

from checkweigher_core.parameters import ParameterError, describe
from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    MAX_WINDOW,
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    Item,
    MassEstimate,
    SampleBlock,
    WeighWindow,
)
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.segmentation.segmenter import Segmenter

EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
DAY = 86_400 * NANOSECONDS
MASS, SPACING = 0.2, 0.5
# Of the line: what comes in between, near the time at which it comes.
Hostile = list[SampleBlock | EyeEdge]
Maker = Callable[[random.Random, SampleBlock], Hostile]


@pytest.fixture(scope='module')
def line() -> Recording:
    return simulated(speed=1.0, masses=(MASS,), count=24, spacing=SPACING)


def blocks(count: int, ahead: float = 0.0, index: int | None = None, later: int = 0) -> Maker:
    """Return a function that makes a block of `count` samples, `ahead` s in index and time.

    `index` replaces the index of the block, and `later` in ns is added to its stamp.
    """

    def make(chance: random.Random, last: SampleBlock) -> Hostile:
        counts = np.random.default_rng(chance.randrange(2**32)).integers(-(2**23), 2**23, count)
        first = last.first_index + round(960 * ahead) if index is None else index
        stamp = last.stamp + round(ahead * NANOSECONDS) + later
        return [SampleBlock(stamp, first, counts.astype(np.int32))]

    return make


def many_blocks(chance: random.Random, last: SampleBlock) -> Hostile:
    times = [chance.gauss(0, 1) for _ in range(200)]
    return [block for time in times for block in blocks(50, time)(chance, last)]


def edges(count: int, spread: float, centre: int = 0) -> Maker:
    """Return a function that makes edges at random times, within `spread` ns of a time."""

    def make(chance: random.Random, last: SampleBlock) -> Hostile:
        times = (last.stamp + centre + round(chance.uniform(-spread, spread)) for _ in range(count))
        return [EyeEdge(time, Eye(chance.randrange(2)), chance.random() < 0.5) for time in times]

    return make


def chatter(chance: random.Random, last: SampleBlock) -> Hostile:
    return [EyeEdge(last.stamp + 1000 * k, Eye(k // 2 % 2), k % 2 == 0) for k in range(2000)]


KINDS: dict[str, Maker] = {
    'a long block': blocks(MAX_WINDOW),
    'a block 1 s ahead': blocks(10, 1.0),
    'a block 5 s ahead': blocks(1000, 5.0),
    'a block 1,000 s ahead': blocks(1000, 1000.0),
    'a block of index 0': blocks(1000, index=0),
    'a block of index 2^63': blocks(1000, index=2**63),
    'a block of the next century': blocks(100, later=36_500 * DAY),
    'a block of the last one': blocks(100, later=-36_500 * DAY),
    'a block an hour old': blocks(100, later=-DAY // 24),
    'an empty block': blocks(0),
    'many blocks': many_blocks,
    'edges around now': edges(1000, 0.5 * NANOSECONDS),
    'edges of the next hour': edges(1000, NANOSECONDS, DAY // 24),
    'edges of the last hour': edges(1000, NANOSECONDS, -DAY // 24),
    'edges of any time': edges(1000, 1e18),
    'chatter': chatter,
}
CLAIMED = {'a block 1 s ahead': 1.0, 'edges around now': 0.5, 'many blocks': 3.5}  # s, time of them


def run(recording: Recording, make: Maker, seed: int) -> tuple[list[Weighing], int]:
    """Weigh a line with hostile records in the middle, and return the items with their times."""
    chance = random.Random(seed)
    stages = WeighingLine(
        recording.load_cell, LineParameters(identifier=IdentifierParameters(estimator='mean'))
    )
    weighings: list[Weighing] = []
    came = recording.blocks[0].stamp + round(chance.uniform(4.0, 5.0) * NANOSECONDS)
    done = False
    for event in recording:
        if isinstance(event, SampleBlock) and event.stamp > came and not done:
            done = True
            for hostile in make(chance, event):
                weighings += stages.add(hostile)
        if isinstance(event, SampleBlock | EyeEdge):
            weighings += stages.add(event)
    return weighings + stages.finish(), came


def check(recording: Recording, kind: str, seed: int) -> int:
    """Check that the second whole product after the time of the hostile records is weighed.

    Also check that no product is weighed twice or wrongly. Returns the number of lost products.
    """
    weighings, came = run(recording, KINDS[kind], seed)
    accepted = [each for each in weighings if each.verdict.decision is Decision.ACCEPT]
    good = {each.verdict.t3 for each in accepted if abs(each.estimate.mass - MASS) < 0.02 * MASS}
    claimed = came + round(CLAIMED.get(kind, 0.0) * NANOSECONDS)
    entries = [e.stamp for e in recording.edges if e.eye == Eye.INFEED and e.blocked]
    exits = [e.stamp for e in recording.edges if e.eye == Eye.OUTFEED and e.blocked]
    whole = [t3 for t1, t3 in zip(entries, exits, strict=True) if t1 > claimed]
    lost = [number for number, t3 in enumerate(whole) if t3 not in good]
    assert len(whole) >= 10
    assert lost in ([], [0]), f'{kind}, seed {seed}: {lost} of {len(whole)}'
    assert len(accepted) == len(good), f'{kind}, seed {seed}: a wrong mass'
    assert len({each.verdict.item_id for each in weighings}) == len(weighings)
    return len(lost)


@pytest.mark.parametrize('kind', KINDS)
def test_the_second_whole_product_after_hostile_records_is_weighed(line: Recording, kind: str):
    check(line, kind, 1)


@pytest.mark.soak
def test_many_hostile_records(line: Recording):
    before = resident_memory(os.getpid())
    lost = Counter(check(line, kind, seed) for seed in range(EXAMPLES or 20) for kind in KINDS)
    after = resident_memory(os.getpid())
    print(f'\nlines by products lost: {dict(lost)}; memory {before} kB before, {after} kB after')
    assert after < 1.1 * before


NUMBERS = (0.0, -1.0, 1e-300, 1e300, math.nan, math.inf, -math.inf, 960.0, 1e9)
STAMPS = (0, 1, -1, 2**62, -(2**62), 1_700_000_000 * NANOSECONDS, 40_000 * DAY, None)


def spoilt(record: Any, chance: random.Random, counts: int) -> Any:
    """Return a window or an estimate with meaningless fields."""
    values: dict[str, Any] = {}
    for entry in fields(record):
        old = getattr(record, entry.name)
        if chance.random() < 0.6:
            continue
        if entry.name in ('t1', 't2', 't3', 'stamp'):
            values[entry.name] = chance.choice(STAMPS[:-1] if entry.name == 'stamp' else STAMPS)
        elif isinstance(old, float):
            values[entry.name] = chance.choice(NUMBERS)
        elif isinstance(old, int):
            values[entry.name] = chance.choice([0, 1, -1, counts, 2**31, 2**63])
        elif isinstance(old, np.ndarray):
            values[entry.name] = np.full(chance.choice([0, 1, 7, counts]), 1, old.dtype)
    return replace(record, **values)


@pytest.fixture(scope='module')
def windows(line: Recording) -> list[WeighWindow]:
    segmenter = Segmenter(line.load_cell, LineParameters().segmenter)
    events = (event for event in line if isinstance(event, SampleBlock | EyeEdge))
    return [window for event in events for window in segmenter.take(event)][:10]


def test_no_window_ends_a_stage_and_the_next_ten_are_weighed(windows: list[WeighWindow]):
    chance = random.Random(1)
    for estimator in ESTIMATORS:
        denoiser = Denoiser(DenoiseParameters())
        identifier = Identifier(IdentifierParameters(estimator=estimator))
        expected = identifier.estimate_all(denoiser.denoise_all(windows))
        for _ in range(EXAMPLES or 15):
            window = spoilt(chance.choice(windows), chance, MAX_WINDOW + 1)
            estimate = identifier.estimate(denoiser.denoise(window))
            assert estimate.reasons or math.isfinite(estimate.mass), window
        found = identifier.estimate_all(denoiser.denoise_all(windows))
        assert [each.mass for each in found] == [each.mass for each in expected]


def test_no_estimate_ends_the_reject_stage_and_the_next_ten_are_judged(windows: list[WeighWindow]):
    chance = random.Random(2)
    stage = RejectStage(LineParameters().reject, 0.2)
    model = MassEstimate(1, 1, 2, 3, mass=0.2, std_dev=1e-3)
    now = 0
    for _ in range(EXAMPLES or 300):
        now += NANOSECONDS // 1000
        stage.take(spoilt(model, chance, 10), now)
        time, eye = chance.choice(STAMPS[:-1]), Eye(chance.randrange(2))
        stage.take(EyeEdge(time, eye, chance.random() < 0.5), now)
    for number, window in enumerate(windows, 5000):
        estimate = replace(
            model, item_id=number, t1=window.t1, t2=window.t2, t3=window.t3, line_speed=1.0
        )
        item = Item(window.t1, 1, number, window.t1, window.t2, window.t3, 1.0, True)
        stage.take(item, now)
        decisions = [verdict.decision for verdict in stage.take(estimate, now)]
        assert decisions == [Decision.ACCEPT]


def at_limits(chance: random.Random) -> dict[str, object]:
    """Return parameters of the stages with some numbers at the ends of their ranges."""
    values: dict[str, object] = {}
    for node in ('segmenter', 'denoise', 'identifier', 'reject'):
        entries = getattr(LineParameters(), node).entries()
        for name in chance.sample(sorted(entries), min(len(entries), chance.randrange(1, 6))):
            default, allowed = entries[name].default, describe(entries[name])
            limit = chance.choice([allowed.minimum, allowed.maximum])
            if isinstance(default, bool | str) or not math.isfinite(limit):
                continue
            kind = int if isinstance(default, int) else float
            whole = (kind(limit),) * len(default) if isinstance(default, tuple) else kind(limit)
            values[f'{node}.{name}'] = whole
    values['identifier.estimator'] = chance.choice(list(ESTIMATORS))
    return values


def weigh_at_limits(recording: Recording, count: int) -> Counter[str]:
    """Weigh lines with parameters at their limits, and count the refused and the weighed ones."""
    told: Counter[str] = Counter()
    for seed in range(count):
        values = at_limits(random.Random(seed))
        try:
            stages = WeighingLine(recording.load_cell, LineParameters().with_values(values))
        except ParameterError as error:
            told['refused' if re.fullmatch('.{,300}', str(error)) else f'{error}'] += 1
            continue
        events = (event for event in recording if isinstance(event, SampleBlock | EyeEdge))
        weighings = list(stages.weigh_all(events))
        for each in weighings:
            assert each.estimate.reasons or math.isfinite(each.estimate.mass), values
        told['run'] += 1
        told['items'] += len(weighings)
    return told


@pytest.mark.parametrize('count', [60, pytest.param(3000, marks=pytest.mark.soak)])
def test_parameters_at_their_limits_are_refused_or_work(count: int):
    told = weigh_at_limits(simulated(speed=1.0, masses=(MASS,), count=3), EXAMPLES or count)
    print(f'\n{dict(told)}')
    assert told.keys() == {'refused', 'run', 'items'}
