# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Training on passes of known mass in bags."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
import sys

from checkweigher_bringup.errors import UserError
from checkweigher_core.printable import one_line
from checkweigher_core.recording import Recording
from checkweigher_core.records import LoadCell, Reference
from checkweigher_core.whole_file import write_whole
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.archive.copying import local_bag
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import over_stretches
from checkweigher_recording.block_cutting import join_stretches
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed, known_passes
from checkweigher_validation.jobs import run_jobs
from checkweigher_validation.tuning.choice import choose
from checkweigher_validation.tuning.parameter_file import accuracy_lines, parameter_file
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked
from checkweigher_validation.tuning.tuner import tune


@dataclass(frozen=True, slots=True)
class BagPasses:
    """What a bag has of passes of known mass.

    `notes` are lines for the user; `problem` is why the bag cannot be used.
    """

    passes: tuple[KnownPass, ...] = ()
    cell: LoadCell | None = None
    notes: tuple[str, ...] = ()
    problem: BagError | None = None


@dataclass(frozen=True, slots=True)
class ReadPasses:
    """Passes of known mass of several bags, a line on each bag, and how many were passed over."""

    passes: list[KnownPass]
    lines: list[str]
    broken: int


def read_passes(
    bags: Sequence[Path | str], lane: str | None, segmenter: SegmenterParameters,
    n_jobs: int | None = None,
) -> ReadPasses:  # fmt: skip
    """Return the passes of known mass in bags; `n_jobs` as in `run_jobs`.

    Of several bags, one that cannot be read is told on stderr and passed over.

    Raises
    ------
    UserError
        If a bag has no such pass, or the bags are of different load cells.
    BagError
        If the only bag, or none of several, can be read.
    """
    calls = [partial(passes_of_bag, str(bag), lane, segmenter, len(bags) == 1) for bag in bags]
    read = run_jobs(calls, n_jobs, 'reading', unit='bags')
    passes: list[KnownPass] = []
    lines = []
    rate = None
    broken = [each.problem for each in read if each.problem is not None]
    if len(broken) == len(bags):
        raise broken[0]
    for problem in broken:
        print(f'{one_line(problem)}; passed over', file=sys.stderr, flush=True)
    for bag, found in zip(bags, read, strict=True):
        if found.cell is None:
            continue
        for note in found.notes:
            print(one_line(note), file=sys.stderr, flush=True)
        if rate not in (None, found.cell.sample_rate):
            raise UserError(
                f'{bag}: sampled at {found.cell.sample_rate:g} Hz, the bags before it at '
                f'{rate:g} Hz; bags of one machine belong together'
            )
        rate = found.cell.sample_rate
        if not found.passes:
            text = 'no pass of known mass; the bag needs reference_mass, stamped with t1'
            raise UserError(f'{bag}: {text}')
        whole = sum(each.whole for each in found.passes)
        lines.append(
            f'{bag}: {whole} passes of {len({each.mass for each in found.passes})} masses, '
            f'{found.cell.model} {found.cell.serial_number}'.rstrip()
        )
        passes += found.passes
    return ReadPasses(passes, lines, len(broken))


def passes_of_bag(
    bag: str, lane: str | None, segmenter: SegmenterParameters, progress: bool
) -> BagPasses:
    """Return the passes of known mass of a bag, of whose samples only their windows are kept."""

    def work(stretches: Iterable[Recording]) -> BagPasses:
        notes: list[str] = []
        references: list[Reference] = []
        stretches = iter(stretches)
        first = next(stretches)

        def taken() -> Iterator[Recording]:
            for stretch in chain([first], stretches):
                references.extend(stretch.references)
                if stretch.warning:
                    notes.append(stretch.warning)
                yield stretch

        # The references are read when the signal has ended, and are all there then.
        events = chain(join_stretches(taken()), references)
        found = known_passes(first.load_cell, events, segmenter)
        return BagPasses(tuple(found), first.load_cell, tuple(notes))

    try:
        with local_bag(bag) as path:
            return over_stretches(work, path, lane, progress=progress)
    except BagError as error:
        return BagPasses(problem=error)


def train(
    bags: Sequence[Path | str], output: Path, estimators: Sequence[str] | None,
    base: LineParameters, *, budget: int = BUDGET, lane: str | None = None,
    n_jobs: int | None = None,
) -> int:  # fmt: skip
    """Tune estimators on the passes of known mass in bags, and write the parameter file.

    The file holds `base` besides, and selects the first estimator. Without names all are tuned and
    compared on held-out passes, and the file holds the one that is chosen. `budget` is the largest
    number of evaluations of each estimator at each speed; `n_jobs` is as in `run_jobs`.
    Returned is how many bags were passed over.
    """
    read = read_passes(bags, lane, unchecked(base.segmenter), n_jobs)
    passes, source = read.passes, read.lines
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
    return read.broken
