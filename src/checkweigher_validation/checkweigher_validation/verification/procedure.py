# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader of verification bags. A bag contains the plan and the signals and results of each step."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
import hashlib
import json
import math
from pathlib import Path

import numpy as np

from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import (
    NANOSECONDS,
    LoadCell,
    MassEstimate,
    StepState,
    Verdict,
    VerificationStep,
    ZeroChange,
)
from checkweigher_core.ros import ports
from checkweigher_dsp.signal.averages import BATCHES, batch_mean_std_error
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.results import mcap_digest, read_records
from checkweigher_validation.verification.plan import Plan, read_plan
from checkweigher_validation.verification.reweighing import conflicts, is_weighed
from checkweigher_validation.verification.steps import Step, steps_of

# Keys of the identity record in a bag. The record contains the name of the program that recorded
# the bag, the name of the audit log, the hash of the last entry in this log, and digests. The value
# of `how` states how the steps were recorded.
IDENTITY = (
    'program',
    'program_sha256',
    'parameters_sha256',
    'audit_log',
    'audit_log_sha256',
    'audit_log_last_hash',
    'audit_log_calibration',  # digest of the latest calibration before the first step
    'how',
)
_NEWER = {'audit_log_calibration': None}  # defaults of keys that bags of older versions lack
OF_BAGS = 'of recorded bags'  # value of `how` if each step is from a bag of its own
SAMPLES_LOST, SATURATED, TOO_SHORT = 'SamplesLost', 'Saturated', 'TooShort'


@dataclass(frozen=True, slots=True)
class ItemPass:
    """One pass of an item. Masses are in kg; an unknown mass is NaN."""

    stamp: int  # t1 in ns, or t3 if t1 is unknown, or 0 if both are unknown
    mass: float
    std_dev: float  # stated standard deviation of the mass, NaN if the mass is NaN
    speed: float  # belt speed in m/s, or NaN if it is unknown
    reasons: tuple[str, ...]  # reasons why the item was not weighed, empty if it was weighed

    @property
    def weighed(self) -> bool:
        """Whether the item got a mass."""
        return not self.reasons


@dataclass(frozen=True, slots=True)
class AtRest:
    """Reading of a load at rest or of the empty belt, in kg relative to the zero of calibration."""

    mass: float  # mean of the samples, NaN like the other masses if the reading is not valid
    std_error: float  # standard error of the mean, from the means of ten successive batches
    noise: float  # standard deviation of the samples
    samples: int  # number of samples
    reasons: tuple[str, ...] = ()  # reasons why the reading is not valid, empty if it is valid


@dataclass(frozen=True, slots=True)
class Attempt:
    """Attempt at a step, with the passes of a load or a reading at rest."""

    step: Step
    begin: int  # start time in ns, equal to `end` if the step was skipped
    end: int  # end time in ns
    passes: tuple[ItemPass, ...] = ()  # passes of a load, empty for a reading at rest
    reading: AtRest | None = None  # reading at rest, or None for passes
    skipped: str = ''  # reason why the step was not made, or empty


@dataclass(frozen=True, slots=True)
class Procedure:
    """Content of the bag of a verification."""

    plan: Plan
    plan_text: str
    identity: Mapping[str, str | None]  # values of the keys in IDENTITY
    load_cell: LoadCell
    attempts: tuple[Attempt, ...]
    zeros: tuple[ZeroChange, ...]  # zeros that the operator has set
    digest: str  # SHA-256 of the bag.
    # Items without a mass that did not enter during an attempt that consists of passes.
    faults_between: tuple[ItemPass, ...] = ()
    # A sentence for each change of settings since the first step, or None if the changes are
    # unknown.
    changes: tuple[str, ...] | None = ()
    # A sentence for each conflict between verdicts, estimates and samples.
    conflicts: tuple[str, ...] = ()


def digest_of(values: object) -> str:
    """Return the SHA-256 digest of JSON values as hexadecimal text.

    Equal values have the same digest.
    """
    text = json.dumps(values, sort_keys=True, separators=(',', ':'))
    return hashlib.sha256(text.encode()).hexdigest()


def read_procedure(path: Path) -> Procedure:
    """Read the bag of a verification.

    Raises `BagError` if the bag is damaged, if it was not recorded by a verification, if its plan
    or its identity record is not valid, or if it contains a step that is not in its plan.
    """
    found = read_records(
        path, ports.VERIFICATION, ports.MASS_ESTIMATE, ports.VERDICT, ports.ZERO_SETTING
    )
    made: list[VerificationStep] = found[ports.VERIFICATION.name]
    estimates, verdicts = found[ports.MASS_ESTIMATE.name], found[ports.VERDICT.name]
    texts = {each.state: each.text for each in made}
    if not {StepState.PLAN, StepState.IDENTITY} <= set(texts):
        raise BagError(f'{path}: contains no verification; the command verify records one')
    try:
        plan = read_plan(texts[StepState.PLAN])
        known = _NEWER | json.loads(texts[StepState.IDENTITY])
        identity = {name: known[name] for name in IDENTITY}
    except (KeyError, ValueError) as error:
        raise BagError(f'{path}: its plan or identity cannot be used: {error}') from None
    changes = known.get('changes')
    recording = read_bag(path)
    passes = item_passes(estimates, verdicts)
    attempts = tuple(_attempts(path, plan, made, passes, recording))
    begun = [each.stamp for each in made if each.state == StepState.BEGUN]
    begins = begun if known['how'] == OF_BAGS else []
    interval = plan.accuracy_class.interval
    return Procedure(
        plan=plan,
        plan_text=texts[StepState.PLAN],
        identity=identity,
        load_cell=recording.load_cell,
        attempts=attempts,
        zeros=tuple(found[ports.ZERO_SETTING.name]),
        digest=mcap_digest(path),
        faults_between=tuple(_faults_between(passes, attempts)),
        changes=None if changes is None else tuple(changes),
        conflicts=tuple(conflicts(recording, estimates, verdicts, known, interval, begins)),
    )


def item_passes(
    estimates: Iterable[MassEstimate], verdicts: Iterable[Verdict]
) -> tuple[ItemPass, ...]:
    """Return a pass for each verdict, in the order of their stamps, with the speed of its estimate.

    The speed is NaN if the verdict has no estimate.
    """
    speeds = {(each.item_id, each.t1): each.belt_speed for each in estimates}
    items = [
        item_pass(each, speeds.get((each.estimate_id, each.t1), math.nan)) for each in verdicts
    ]
    return tuple(sorted(items, key=lambda item: item.stamp))


def item_pass(verdict: Verdict, speed: float) -> ItemPass:
    """Return the pass that a verdict describes, with a belt speed in m/s.

    The mass is NaN if the item was not weighed.
    """
    weighed = is_weighed(verdict)
    reasons = () if weighed else tuple(verdict.reasons) or ('Unknown',)
    mass, std_dev = (verdict.mass, verdict.std_dev) if weighed else (math.nan, math.nan)
    return ItemPass(verdict.t1 or verdict.t3 or 0, mass, std_dev, speed, reasons)


def _faults_between(passes: Sequence[ItemPass], attempts: Sequence[Attempt]) -> Iterator[ItemPass]:
    spans = [(each.begin, each.end) for each in attempts if not each.skipped and each.step.count]
    for item in passes:
        if not item.weighed and not any(begin <= item.stamp <= end for begin, end in spans):
            yield item


def _attempts(
    path: Path,
    plan: Plan,
    made: Sequence[VerificationStep],
    passes: Sequence[ItemPass],
    recording: Recording,
) -> Iterator[Attempt]:
    steps = {step.name: step for step in steps_of(plan)}
    for each in made:
        if each.state not in (StepState.DONE, StepState.SKIPPED):
            continue
        if each.step not in steps:
            raise BagError(f'{path}: its plan has no step {each.step!r}')
        step, begin, end = steps[each.step], each.begin or 0, each.stamp
        if each.state == StepState.SKIPPED:
            yield Attempt(step, end, end, skipped=each.text or 'skipped')
        elif step.at_rest:
            yield Attempt(step, begin, end, reading=reading_between(recording, begin, end))
        else:
            own = tuple(item for item in passes if begin <= item.stamp <= end)
            yield Attempt(step, begin, end, own)


def reading_between(recording: Recording, begin: int, end: int) -> AtRest:
    """Return the reading from the sample blocks that are completely between two times in ns.

    The reading is not valid if there are fewer than ``10 * BATCHES`` samples, if samples between
    the blocks were lost, or if a sample is at an end of the range of the converter. The masses of a
    reading that is not valid are NaN, and `reasons` contains the first of the reasons that apply.
    """
    cell, blocks = recording.load_cell, BlockColumns.of(recording.blocks)
    durations = (blocks.lengths * (NANOSECONDS / cell.sample_rate)).astype(np.int64)
    inside = np.flatnonzero((blocks.stamps >= begin) & (blocks.stamps + durations <= end))
    chosen = blocks.take(inside)
    firsts, counts = chosen.first_indices.astype(np.int64), chosen.counts
    reason = ''
    if len(counts) < 10 * BATCHES:
        reason = TOO_SHORT
    elif np.any(firsts[1:] != firsts[:-1] + chosen.lengths[:-1]):
        reason = SAMPLES_LOST
    elif np.any((counts <= cell.min_counts) | (counts >= cell.max_counts)):
        reason = SATURATED
    if reason:
        return AtRest(math.nan, math.nan, math.nan, len(counts), (reason,))
    masses = (counts.astype(np.float64) - cell.zero_counts) / cell.counts_per_kg
    noise = float(np.std(masses, ddof=1))
    return AtRest(float(np.mean(masses)), batch_mean_std_error(masses), noise, len(masses))
