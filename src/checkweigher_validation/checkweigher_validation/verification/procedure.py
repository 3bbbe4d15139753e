# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A procedure as its bag holds it: the plan, each attempt at a step, and what was read in it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
import json
import math
from pathlib import Path

import numpy as np

from checkweigher_core.recording import BlockColumns
from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
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
from checkweigher_validation.verification.steps import Step, steps_of

# What a bag says of itself: which program recorded it, and digests of what is not in it. The last
# time, after the last step, it says also what has changed since the first one.
IDENTITY = (
    'program', 'program_sha256', 'parameters_sha256', 'audit_log', 'audit_log_sha256',
    'audit_log_last_hash', 'how',
)  # fmt: skip
SAMPLES_LOST, SATURATED, TOO_SHORT = 'SamplesLost', 'Saturated', 'TooShort'


@dataclass(frozen=True, slots=True)
class ItemPass:
    """One item that passed; kg and m/s, NaN where not known."""

    stamp: int  # ns, its t1, or t3 where that is all there is
    mass: float
    std_dev: float  # as the identifier states it
    speed: float
    reasons: tuple[str, ...]  # why it was not weighed

    @property
    def weighed(self) -> bool:
        """Whether it got a mass."""
        return not self.reasons


@dataclass(frozen=True, slots=True)
class AtRest:
    """What rests on the belt; kg above the zero of calibration, or why there is no reading."""

    mass: float
    std_error: float  # of the mean, by those of ten successive batches
    noise: float  # standard deviation of the samples
    samples: int
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Attempt:
    """One attempt at a step, from `begin` to `end` in ns; not made if it was `skipped`."""

    step: Step
    begin: int
    end: int
    passes: tuple[ItemPass, ...] = ()
    reading: AtRest | None = None
    skipped: str = ''  # why


@dataclass(frozen=True, slots=True)
class Procedure:
    """All that a bag of a procedure holds."""

    plan: Plan
    plan_text: str
    identity: Mapping[str, str | None]  # what ran, and with which parameters; see IDENTITY
    load_cell: LoadCell
    attempts: tuple[Attempt, ...]
    zeros: tuple[ZeroChange, ...]  # by the service zero
    digest: str  # SHA-256 of the bag
    faults_between: tuple[ItemPass, ...] = ()  # items without a mass that are passes of no attempt
    # Sentences on what was another one after the last step; None if that was not looked at.
    changes: tuple[str, ...] | None = ()


def read_procedure(path: Path) -> Procedure:
    """Read the bag of a procedure.

    Raises
    ------
    BagError
        If it is no such bag, or damaged.
    """
    found = read_records(
        path, ports.VERIFICATION, ports.MASS_ESTIMATE, ports.VERDICT, ports.ZERO_SETTING
    )
    told: list[VerificationStep] = found[ports.VERIFICATION.name]
    texts = {each.state: each.text for each in told}
    if not {StepState.PLAN, StepState.IDENTITY} <= set(texts):
        raise BagError(f'{path}: holds no verification; "verify" with a plan records one')
    try:
        plan = read_plan(texts[StepState.PLAN])
        identity, changes = _identity(texts[StepState.IDENTITY])
    except (KeyError, ValueError) as error:
        raise BagError(f'{path}: its plan or identity cannot be used: {error}') from None
    recording = read_bag(path)
    blocks = BlockColumns.of(recording.blocks)
    passes = item_passes(found[ports.MASS_ESTIMATE.name], found[ports.VERDICT.name])
    steps = {step.name: step for step in steps_of(plan)}
    attempts = []
    for each in told:
        if each.state not in (StepState.DONE, StepState.SKIPPED):
            continue
        if each.step not in steps:
            raise BagError(f'{path}: step {each.step!r} is none of its plan')
        attempts.append(_attempt(steps[each.step], each, passes, blocks, recording.load_cell))
    return Procedure(
        plan, texts[StepState.PLAN], identity, recording.load_cell,
        tuple(attempts), tuple(found[ports.ZERO_SETTING.name]), mcap_digest(path),
        _faults_between(passes, attempts), changes,
    )  # fmt: skip


def _identity(text: str) -> tuple[dict[str, str | None], tuple[str, ...] | None]:
    """Return what is verified, and what has changed; KeyError if it is not all there."""
    found = json.loads(text)
    changes = found.pop('changes', None)
    return {name: found[name] for name in IDENTITY}, None if changes is None else tuple(changes)


def item_passes(
    estimates: Iterable[MassEstimate], verdicts: Iterable[Verdict]
) -> tuple[ItemPass, ...]:
    """Return the items of verdicts in the order of entry, with the speeds of their estimates."""
    speeds = {(each.item_id, each.t1): each.belt_speed for each in estimates}
    return tuple(
        sorted(
            (
                item_pass(each, speeds.get((each.estimate_id, each.t1), math.nan))
                for each in verdicts
            ),
            key=lambda item: item.stamp,
        )
    )


def item_pass(verdict: Verdict, speed: float) -> ItemPass:
    """Return the item of a verdict; one that is a FAULT has no mass."""
    fault = verdict.decision == Decision.FAULT or not math.isfinite(verdict.mass)
    reasons = tuple(verdict.reasons) or ('Unknown',) if fault else ()
    mass, std_dev = (math.nan, math.nan) if fault else (verdict.mass, verdict.std_dev)
    return ItemPass(verdict.t1 or verdict.t3 or 0, mass, std_dev, speed, reasons)


def _faults_between(
    passes: Sequence[ItemPass], attempts: Sequence[Attempt]
) -> tuple[ItemPass, ...]:  # fmt: skip
    """Return the items without a mass that are passes of no attempt."""
    spans = [(each.begin, each.end) for each in attempts if not each.skipped and each.step.count]
    return tuple(
        item
        for item in passes
        if not item.weighed and not any(begin <= item.stamp <= end for begin, end in spans)
    )


def _attempt(
    step: Step, told: VerificationStep, passes: Sequence[ItemPass], blocks: BlockColumns,
    load_cell: LoadCell,
) -> Attempt:  # fmt: skip
    begin, end = told.begin or 0, told.stamp
    if told.state == StepState.SKIPPED:
        return Attempt(step, end, end, skipped=told.text or 'skipped')
    if step.at_rest:
        return Attempt(step, begin, end, reading=_reading(blocks, begin, end, load_cell))
    own = tuple(each for each in passes if begin <= each.stamp <= end)
    return Attempt(step, begin, end, own)


def _reading(blocks: BlockColumns, begin: int, end: int, load_cell: LoadCell) -> AtRest:
    """Return the reading of the blocks that lie in a span, ns."""
    durations = (blocks.lengths * (NANOSECONDS / load_cell.sample_rate)).astype(np.int64)
    inside = np.flatnonzero((blocks.stamps >= begin) & (blocks.stamps + durations <= end))
    chosen = blocks.take(inside)
    firsts = chosen.first_indices.astype(np.int64)
    counts, cell = chosen.counts, load_cell
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
    return AtRest(
        float(np.mean(masses)), batch_mean_std_error(masses),
        float(np.std(masses, ddof=1)), len(masses),
    )  # fmt: skip
