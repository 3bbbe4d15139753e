# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification procedure from recorded steps, with one bag for each step."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
import itertools
from pathlib import Path
from typing import Any

from checkweigher_bringup.commissioning.identity import Identity
from checkweigher_bringup.errors import UserError
from checkweigher_core.block_cutting import join_recording
from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    EyeEdge,
    LoadCell,
    Reference,
    SampleBlock,
    StepState,
    VerificationStep,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import Port
from checkweigher_driver.calibration.static_calibration import RestReading, Steadiness
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.writing import BagWriter
from checkweigher_validation.verification.plan import Plan
from checkweigher_validation.verification.procedure import OF_BAGS
from checkweigher_validation.verification.steps import Step, steps_of

_Record = tuple[int, Port, Any]  # stamp in ns, port, record
_PORTS = {
    SampleBlock: ports.LOAD_CELL_SAMPLES,
    EyeEdge: ports.PHOTO_EYES,
    Reference: ports.REFERENCE_MASS,
}
_SAME_LOAD = 0.01  # maximum relative difference of a reference mass from the load of its step


def procedure_of_bags(
    plan: Plan,
    text: str,
    bags: Sequence[Path],
    parameters: LineParameters,
    identity: Identity,
    output: Path,
) -> None:
    """Weigh the bags of the steps, and write the bag of the procedure.

    Each bag has the name of its step. All bags are weighed with the same parameters, so the
    procedure has one identity of the machine.

    Raises `UserError` if a bag does not have the name of a step, if the calibrations of the bags
    differ, if a reference mass differs from the load in the plan, or if bags overlap in time.
    Raises the exceptions of `_rest` if a load does not come to rest.
    """
    steps = {step.name: step for step in steps_of(plan)}
    for bag in bags:
        if bag.name not in steps:
            raise UserError(f'{bag}: the name is not a step of the plan; verify --steps lists them')
    found = [(bag, steps[bag.name], read_bag(bag)) for bag in bags]
    found.sort(key=lambda each: each[2].blocks[0].stamp)
    _check_together(found)
    values = {name: getattr(parameters, name).as_mapping() for name in ports.STAGES}
    cell, begin = found[0][2].load_cell, found[0][2].blocks[0].stamp
    identity.at_begin(values, OF_BAGS)
    what = identity.at_end(values)
    with BagWriter(output, ports.RECORDED) as writer:
        for port, record in (
            (ports.LOAD_CELL_INFO, cell),
            (ports.VERIFICATION, VerificationStep(begin, '', StepState.PLAN, text=text)),
            (ports.VERIFICATION, VerificationStep(begin, '', StepState.IDENTITY, text=what)),
        ):
            writer.put_record(port, begin, record)
        items = 0
        for bag, step, recording in found:
            for stamp, port, record in _records(bag, step, recording, plan, parameters, items):
                if port is ports.VERDICT:
                    items = max(items, record.item_id)
                writer.put_record(port, stamp, record)


def _check_together(found: Sequence[tuple[Path, Step, Recording]]) -> None:
    """Raise `UserError` if bags cannot belong to one procedure.

    The bags must not overlap in time, must have the same load cell and calibration, and their
    reference masses must agree with the loads of their steps. `found` is sorted by time.
    """
    for (before, _, first), (after, _, second) in itertools.pairwise(found):
        if second.blocks[0].stamp < end_of_block(first.blocks[-1], first.load_cell):
            raise UserError(f'{after}: begins before {before} ends; bags must not overlap')
        if second.load_cell != first.load_cell:
            raise UserError(f'{after}: has another calibration than {before}; record all again')
    for bag, step, recording in found:
        for known in recording.references:
            if step.load and abs(known.mass / step.load.mass - 1) > _SAME_LOAD:
                raise UserError(
                    f'{bag}: its reference_mass is {GRAMS * known.mass:g} g, but in the plan '
                    f'{step.load.name} is {GRAMS * step.load.mass:g} g'
                )


def end_of_block(block: SampleBlock, load_cell: LoadCell) -> int:
    """Return the time in ns that is one sample period after the last sample of a block."""
    return block.stamp + round(len(block.counts) * NANOSECONDS / load_cell.sample_rate)


def _records(
    bag: Path, step: Step, recording: Recording, plan: Plan, parameters: LineParameters, items: int
) -> Iterator[_Record]:
    """Yield all records of a step in order of time, with item numbers above `items`.

    The records are the start of the step, the recorded inputs, the estimates and verdicts of the
    items, and the end of the step. Raises the exceptions of `_rest`.
    """
    begin, end = recording.blocks[0].stamp, end_of_block(recording.blocks[-1], recording.load_cell)
    if step.at_rest:
        begin, end = _rest(bag, recording, Steadiness(plan.rest.duration_s, plan.rest.tolerance))
    yield begin, ports.VERIFICATION, VerificationStep(begin, step.name, StepState.BEGUN, begin)
    made: list[_Record] = [(each.stamp, _PORTS[type(each)], each) for each in recording]
    line = WeighingLine(recording.load_cell, parameters)
    for weighing in line.weigh_all(join_recording(recording)):
        made += _results(weighing, items, begin)
    # The sort is stable, so an estimate stays before its verdict.
    yield from sorted(made, key=lambda each: each[0])
    end_mark = VerificationStep(end, step.name, StepState.DONE, begin)
    yield max(end, made[-1][0]), ports.VERIFICATION, end_mark


def _results(weighing: Weighing, items: int, begin: int) -> Iterator[_Record]:
    """Yield the estimate, if there is one, and the verdict of an item.

    The number `items` is added to the item numbers of estimate and verdict. The stamp of both
    records is t3, or t1 if t3 is unknown. If t3 and t1 are unknown, the stamp is `begin`, the start
    of the step in ns.
    """
    estimate, verdict = weighing.estimate, weighing.verdict
    stamp = verdict.t3 or verdict.t1 or begin
    if verdict.estimate_id:
        yield (stamp, ports.MASS_ESTIMATE, replace(estimate, item_id=items + estimate.item_id))
        verdict = replace(verdict, estimate_id=items + verdict.estimate_id)
    yield stamp, ports.VERDICT, replace(verdict, item_id=items + verdict.item_id)


def _rest(bag: Path, recording: Recording, steadiness: Steadiness) -> tuple[int, int]:
    """Return the start and end in ns of the first segment in which the load is at rest.

    Raises `UserError` if the recording ends before there is such a segment, and `CalibrationError`
    if the load does not come to rest in time or the converter is at its limit.
    """
    reading = RestReading(recording.load_cell, steadiness)
    for block in recording.blocks:
        if reading.add(block) is not None:
            end = end_of_block(block, recording.load_cell)
            return end - round(steadiness.duration * NANOSECONDS), end
    raise UserError(
        f'{bag}: the load is never at rest for {steadiness.duration:g} s within '
        f'{GRAMS * steadiness.tolerance:g} g; see the section rest of the plan'
    )
