# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Training on passes of known mass in bags."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
import sys

from joblib import delayed

from checkweigher_bringup.errors import UserError
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.printable import one_line
from checkweigher_dsp.records import LoadCell
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.block_cutting import join_recording
from checkweigher_recording.whole_file import write_whole
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed, known_passes
from checkweigher_validation.jobs import ALL_CORES, run_jobs
from checkweigher_validation.tuning.choice import choose
from checkweigher_validation.tuning.parameter_file import accuracy_lines, parameter_file
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked
from checkweigher_validation.tuning.tuner import tune


def read_passes(
    bags: Sequence[Path], lane: str | None, segmenter: SegmenterParameters,
    n_jobs: int | None = None,
) -> tuple[list[KnownPass], list[str]]:  # fmt: skip
    """Return the passes of known mass in bags, and a line on each bag; `n_jobs` as in `run_jobs`.

    A UserError says that a bag has none or that the bags are of different load cells, a BagError
    that a bag cannot be read.
    """
    calls = [delayed(_read_bag)(bag, lane, segmenter, len(bags) == 1) for bag in bags]
    read = run_jobs(calls, n_jobs, 'reading', unit='bags')
    passes: list[KnownPass] = []
    lines = []
    rate = None
    for bag, (cell, found, unfinished) in zip(bags, read, strict=True):
        if unfinished:
            print(one_line(unfinished), file=sys.stderr, flush=True)
        if rate not in (None, cell.sample_rate):
            raise UserError(
                f'{bag}: sampled at {cell.sample_rate:g} Hz, the bags before it at {rate:g} Hz; '
                'bags of one machine belong together'
            )
        rate = cell.sample_rate
        if not found:
            text = 'no pass of known mass; the bag needs reference_mass, stamped with t1'
            raise UserError(f'{bag}: {text}')
        whole = sum(each.whole for each in found)
        lines.append(
            f'{bag}: {whole} passes of {len({each.mass for each in found})} masses, '
            f'{cell.model} {cell.serial_number}'.rstrip()
        )
        passes += found
    return passes, lines


def _read_bag(
    bag: Path, lane: str | None, segmenter: SegmenterParameters, progress: bool
) -> tuple[LoadCell, list[KnownPass], str]:
    """Return load cell and passes of a bag, and a line if it is only the beginning of one."""
    recording = read_bag(bag, lane, progress=progress)
    events = chain(recording.references, join_recording(recording))
    passes = known_passes(recording.load_cell, events, segmenter)
    return recording.load_cell, passes, recording.unfinished or recording.doubt


def train(
    bags: Sequence[Path], output: Path, estimators: Sequence[str] | None, base: LineParameters, *,
    budget: int = BUDGET, lane: str | None = None, jobs: int | None = None,
) -> None:  # fmt: skip
    """Tune estimators on the passes of known mass in bags, and write the parameter file.

    The file holds `base` besides, and selects the first estimator. Without names all are tuned and
    compared on held-out passes, and the file holds the one that is chosen. `budget` is the largest
    number of evaluations of each estimator at each speed; `jobs` is the number of processes, one
    for each core by default.
    """
    n_jobs = jobs or ALL_CORES
    passes, source = read_passes(bags, lane, unchecked(base.segmenter), n_jobs)
    base = replace(base, segmenter=stated_lag(passes, base.segmenter))
    names = tuple(estimators or ESTIMATORS)
    tuned = tune(
        group_by_speed(passes), names, base, budget=budget, n_jobs=n_jobs,
        skip_failing=estimators is None,
    )  # fmt: skip
    if estimators is None:
        choice = choose(tuned)
        best = {choice.estimator: tuned[choice.estimator]}
        text = parameter_file(best, source, compared=tuned, reason=choice.reason)
    else:
        text = parameter_file(tuned, source)
    write_whole(output, text)
    print('\n'.join(accuracy_lines(text)))
