# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples that lag behind the photo-eyes: no wrong mass is accepted, and no right mass is refused.

Possible causes are the filter of an amplifier, two clocks or a debounced eye. The stamps of the
samples of a bag are moved by a constant, either all of them or those of the second half.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
import os
from pathlib import Path

from lines import simulated, weigh_all, write_line
import numpy as np
from numpy.typing import NDArray
import pytest
from running import BAGS, ROOT, Rows, Run

from checkweigher_core.recording import Recording, canonical_order
from checkweigher_core.records import NANOSECONDS
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.pipeline.line import LineParameters, Weighing
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.simulation.simulator import PROFILES
from checkweigher_validation.accuracy.passes import ReferenceMasses

MACHINES = Path(os.environ.get('CHECKWEIGHER_MACHINES', ROOT.parent / 'shared' / 'machines'))
MS = 1_000_000  # ns
LIMIT = 4.0  # stated standard deviations
# Less moves no window: it is within what platforms differ by, and costs up to one more of them.
UNMOVED, LIMIT_UNMOVED = 0.6, 5.0  # ms
# Of estimators that state too little on the bags as they are: up to 6.2.
LIMITS = {'aeksi': 9.0}
NAMES = ('iswd_eksi', 'hann', 'gauss_markov', 'tvlpf', 'mean', 'aid', 'aeksi', 'fir_model')
SHIFTS = (
    *(-60, -40, -30, -25, -20, -15, -12, -10, -8, -7, -6, -5, -4, -3, -2.5, -2, -1.5, -1, -0.5),
    *(0.5, 1, 1.5, 2, 2.5, 3, 4, 5, 6, 7, 8, 10, 12, 15, 20, 25, 30, 40, 60),
)


def shifted(recording: Recording, shift: float, begin: float = 0.0) -> Recording:
    """Return the line with samples that are `shift` ms later after the fraction `begin` of it."""
    first, last = recording.blocks[0].stamp, recording.blocks[-1].stamp
    start = first + begin * (last - first)
    blocks = (
        replace(each, stamp=each.stamp + round(MS * shift)) if each.stamp >= start else each
        for each in recording.blocks
    )
    return Recording.from_events(
        recording.load_cell, [*blocks, *recording.edges, *recording.references]
    )


def errors(weighings: Iterable[Weighing], recording: Recording) -> NDArray[np.float64]:
    """Return the errors of masses in units of their stated deviations; NaN for a FAULT."""
    masses = ReferenceMasses(recording.references)
    return np.array([
        (each.estimate.mass - masses.at(each.estimate.t1)) / each.estimate.std_dev
        for each in weighings
    ])  # fmt: skip


def campaign(
    bags: Iterable[str], estimators: Iterable[str], shifts: Iterable[float],
    begins: Iterable[float],
) -> None:  # fmt: skip
    """Weigh bags with moved samples, print the counts, and check that no wrong mass is accepted."""
    recordings = {bag: read_bag(BAGS / bag) for bag in bags}
    shifts, begins = list(shifts), list(begins)
    escapes = []
    for name in estimators:
        parameters = LineParameters().with_estimator(name)
        counts: Counter[str] = Counter()
        for bag, recording in recordings.items():
            for begin in begins:
                for shift in shifts:
                    moved = shifted(recording, shift, begin)
                    off = np.abs(errors(weigh_all(moved, parameters), recording))
                    limit = LIMIT_UNMOVED if abs(shift) < UNMOVED else LIMIT
                    escaped = int(np.sum(off > LIMITS.get(name, limit)))
                    counts['tried'] += len(off)
                    counts['fault'] += int(np.sum(np.isnan(off)))
                    counts['escaped'] += escaped
                    if escaped:
                        escapes.append((name, bag, begin, shift, float(np.nanmax(off))))
        accepted = counts['tried'] - counts['fault'] - counts['escaped']
        print(
            f'\n{name}: {counts["tried"]} items tried, {accepted} accepted within the limit, '
            f'{counts["fault"]} faults, {counts["escaped"]} escaped',
            end='',
        )
    assert not escapes


def test_no_wrong_mass_is_accepted_where_samples_are_off():
    shifts = (-60, -5, -1, 2, 15)  # `make soak` tries all
    campaign(['paper_30', 'paper_90'], ['iswd_eksi'], shifts, [0.0, 0.5])


@pytest.mark.soak
@pytest.mark.parametrize('estimator', NAMES)
def test_no_wrong_mass_is_accepted_at_any_shift_by_any_estimator(estimator: str):
    bags = sorted(path.name for path in BAGS.iterdir() if path.is_dir())
    campaign(bags, [estimator], SHIFTS, [0.0, 0.3, 0.5])


def jittering(recording: Recording, random: np.random.Generator) -> Recording:
    """Return the line with the load of each item moved by a random time of about 1 ms."""
    off = random.normal(0.0, MS, len(recording.edges))
    seen: Counter[tuple[int, bool]] = Counter()
    edges = []
    for edge in recording.edges:
        kind = edge.eye, edge.blocked
        edges.append(replace(edge, stamp=edge.stamp + round(off[seen[kind]])))
        seen[kind] += 1
    return replace(recording, edges=tuple(sorted(edges, key=canonical_order)))


@pytest.mark.parametrize('bag', ['paper_30', 'paper_60', 'paper_90'])
def test_a_jitter_of_a_millisecond_is_no_fault(bag: str):
    recording = read_bag(BAGS / bag)
    moved = jittering(recording, np.random.default_rng(1))
    masses = ReferenceMasses(recording.references)
    entries = [edge.stamp for edge in recording.edges if not edge.eye and edge.blocked]
    weighings = list(weigh_all(moved))

    assert all(done.estimate.weighed for done in weighings)
    off = [
        (done.estimate.mass - masses.at(entry)) / done.estimate.std_dev
        for entry, done in zip(entries, weighings, strict=True)
    ]
    assert np.sqrt(np.mean(np.square(off))) < 2.0


@pytest.mark.parametrize('profile', PROFILES)
def test_no_good_item_is_refused_on_simulated_machines(profile: str):
    for speed in (0.5, 1.5):
        line = simulated(profile=profile, speed=speed, count=30, seed=7)
        assert all(done.estimate.weighed for done in weigh_all(line))


@pytest.mark.parametrize('speed', [1.0, 1.5])
def test_what_a_slow_amplifier_makes_of_good_items_is_no_distance_fault(speed: float):
    line = simulated(profile='machine:212', speed=speed, count=30, seed=1)  # it lags by 28 ms
    weighings = list(weigh_all(line))
    reasons = {reason for done in weighings for reason in done.estimate.reasons}
    assert reasons == {'EdgeMismatch'}


@pytest.mark.soak
@pytest.mark.skipif(not MACHINES.is_dir(), reason='no bags of machines that nobody modelled here')
def test_no_good_item_is_refused_on_machines_that_nobody_modelled():
    parameters = LineParameters().with_estimator('hann')
    items = 0
    for bag in sorted(MACHINES.glob('machine_*/*_[0-9]*')):
        weighings = list(weigh_all(read_bag(bag), parameters))
        items += len(weighings)
        assert not [done.verdict.reasons for done in weighings if not done.estimate.weighed], bag
    print(f'\n{items} items tried, 0 faults', end='')


@pytest.mark.soak
@pytest.mark.skipif(not MACHINES.is_dir(), reason='no bags of machines that nobody modelled here')
@pytest.mark.parametrize('shift', [0.0, -5.0, -10.0])
def test_what_a_shift_costs_where_products_ride_on_unevenly(shift: float):
    recordings = map(read_bag, sorted(MACHINES.glob('machine_*/*_[0-9]*')))
    found = [
        np.abs(errors(weigh_all(shifted(recording, shift)), recording)) for recording in recordings
    ]
    off = np.concatenate(found)
    beyond, largest = int(np.sum(off > LIMIT)), float(np.nanmax(off))
    print(
        f'\n{shift:g} ms: {len(off)} items tried, {beyond} beyond {LIMIT:g}, largest {largest:.1f}'
    )
    # Untrained, a slow swing of an unknown machine is as long as the window of a fast belt.
    assert beyond <= (0.005 if shift else 0.001) * len(off)
    assert largest < 6.0


def test_items_after_the_end_of_a_shift_are_weighed_again():
    recording = read_bag(BAGS / 'paper_60')
    first, last = recording.blocks[0].stamp, recording.blocks[-1].stamp
    begin, end = (first + round(share * (last - first)) for share in (0.3, 0.6))
    blocks = [
        replace(each, stamp=each.stamp + 12 * MS) if begin <= each.stamp < end else each
        for each in recording.blocks
    ]
    moved = Recording.from_events(
        recording.load_cell, [*blocks, *recording.edges, *recording.references]
    )
    weighings = list(weigh_all(moved))
    during = [done for done in weighings if begin + NANOSECONDS < (done.estimate.t1 or 0) < end]
    after = [done for done in weighings if (done.estimate.t1 or 0) > end]

    assert {reason for done in during for reason in done.verdict.reasons} == {Reason.EDGE_MISMATCH}
    assert len(after) >= 10
    assert np.all(np.abs(errors(after[1:], recording)) < LIMIT)


def test_a_tuned_line_knows_its_lag(checkweigher: Run, rows: Rows, tmp_path: Path):
    late, later = tmp_path / 'late', tmp_path / 'later'
    recording = read_bag(BAGS / 'paper_60')
    for bag, shift in ((late, 4.0), (later, 12.0)):
        write_line(bag, shifted(recording, shift))
    tuned = tmp_path / 'tuned.yaml'
    checkweigher('tune', late, '--estimator', 'hann', '--budget', 1, '--output', tuned)
    known = LineParameters.from_file(tuned).segmenter

    assert known.rise_lag_known
    assert known.rise_lag == pytest.approx(SegmenterParameters().rise_lag + 0.004, abs=2e-4)
    assert {row['decision'] for row in rows('weigh', late, '--params', tuned)} == {'ACCEPT'}
    for bag in (later, BAGS / 'paper_60'):
        reasons = {row['reasons'] for row in rows('weigh', bag, '--params', tuned)}
        assert reasons == ({Reason.EDGE_MISMATCH} if bag is later else {''})


@pytest.mark.parametrize('options', [(), pytest.param(('--processes',), marks=pytest.mark.soak)])
def test_a_replay_of_moved_samples_gives_the_same_bytes(
    rows: Rows, tmp_path: Path, options: tuple[str, ...]
):
    bag = write_line(tmp_path / 'bag', shifted(read_bag(BAGS / 'paper_90'), 3.0, 0.5))
    assert rows('replay', bag, '--rate', '0', *options) == rows('weigh', bag)
