# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Training of the estimators on passes of known mass in bags."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from pathlib import Path

from checkweigher_bringup.errors import UserError, warn
from checkweigher_core.block_cutting import join_stretches
from checkweigher_core.recording import Recording
from checkweigher_core.records import LoadCell, Reference
from checkweigher_core.whole_file import write_whole
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.archive.copying import local_bag
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import over_stretches
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed, passes_by_cut
from checkweigher_validation.jobs import run_jobs
from checkweigher_validation.tuning.choice import CANDIDATES, choose, with_untrained
from checkweigher_validation.tuning.parameter_file import accuracy_lines, parameter_file
from checkweigher_validation.tuning.stated_lag import stated_lag, unchecked
from checkweigher_validation.tuning.tuner import tune


@dataclass(frozen=True, slots=True)
class BagPasses:
    """Passes of known mass in a bag, the load cell, and notes for the user.

    `untrained` is empty, or contains the same passes with windows that are cut with the parameters
    before training.
    """

    passes: tuple[KnownPass, ...]
    untrained: tuple[KnownPass, ...]
    cell: LoadCell
    notes: tuple[str, ...]

    def __str__(self) -> str:
        whole = sum(each.whole for each in self.passes)
        masses = len({each.mass for each in self.passes})
        cell = f'{self.cell.model} {self.cell.serial_number}'
        return f'{whole} passes of {masses} masses, {cell}'.rstrip()


@dataclass(frozen=True, slots=True)
class ReadPasses:
    """Passes of known mass in several bags.

    `lines` contains a text on each bag that was read, and `broken` is the number of skipped bags.
    """

    passes: list[KnownPass]
    lines: list[str]
    broken: int
    untrained: list[KnownPass] = field(default_factory=list)  # as in `BagPasses`


def read_passes(
    bags: Sequence[Path | str],
    lane: str | None,
    segmenter: SegmenterParameters,
    n_jobs: int | None = None,
    untrained: SegmenterParameters | None = None,
) -> ReadPasses:
    """Return the passes of known mass in bags.

    The windows of `ReadPasses.passes` are cut with the parameters `segmenter`, and those of
    `ReadPasses.untrained` with `untrained`. If the parameter `untrained` is None,
    `ReadPasses.untrained` is empty. `n_jobs` is the number of processes, as in `run_jobs`. Bags
    that cannot be read are reported on stderr and skipped. Raises `UserError` if a bag has no pass
    of known mass, or another sample rate than the first of the bags that can be read, and
    `BagError` if no bag can be read.
    """
    cuts = list(filter(None, (segmenter, untrained)))
    calls = [partial(passes_of_bag, str(bag), lane, cuts, len(bags) == 1) for bag in bags]
    found = list(zip(bags, run_jobs(calls, n_jobs, 'reading'), strict=True))
    broken = [each for _, each in found if isinstance(each, BagError)]
    if len(broken) == len(bags):
        raise broken[0]
    for problem in broken:
        warn(f'{problem}; skipped')
    read = [(bag, each) for bag, each in found if not isinstance(each, BagError)]
    for bag, each in read:
        _check(f'{bag}', each, rate=read[0][1].cell.sample_rate)
    return ReadPasses(
        passes=list(chain.from_iterable(each.passes for _, each in read)),
        lines=[f'{bag}: {each}' for bag, each in read],
        broken=len(broken),
        untrained=list(chain.from_iterable(each.untrained for _, each in read)),
    )


def _check(bag: str, found: BagPasses, rate: float) -> None:
    """Print the notes on a bag. Raise `UserError` if the passes of the bag cannot be used.

    The bag must have a pass of known mass, and the sample rate `rate` in Hz.
    """
    for note in found.notes:
        warn(note)
    if found.cell.sample_rate != rate:
        raise UserError(
            f'{bag}: the sample rate is {found.cell.sample_rate:g} Hz, but {rate:g} Hz in the '
            'first bag; give bags of one machine'
        )
    if not found.passes:
        raise UserError(
            f'{bag}: no pass of known mass; it needs messages on reference_mass with the stamp t1'
        )


def passes_of_bag(
    bag: str, lane: str | None, cuts: Sequence[SegmenterParameters], progress: bool
) -> BagPasses | BagError:
    """Return the passes of known mass in a bag, or the error if the bag cannot be read.

    `cuts` contains the parameters with which the windows of `BagPasses.passes` and, optionally, of
    `BagPasses.untrained` are cut. Samples outside the passes are dropped, because a bag may be
    larger than the memory.
    """

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

        # `chain` reads `references` last, when all parts of the bag have added their references.
        events = chain(join_stretches(taken()), references)
        found, *others = passes_by_cut(first.load_cell, events, cuts)
        return BagPasses(tuple(found), tuple(chain(*others)), first.load_cell, tuple(notes))

    try:
        with local_bag(bag) as path:
            return over_stretches(work, path, lane, progress=progress)
    except BagError as error:
        return error


def train(
    bags: Sequence[Path | str],
    output: Path,
    estimators: Sequence[str] | None,
    base: LineParameters,
    *,
    budget: int,
    lane: str | None = None,
    n_jobs: int | None = None,
) -> int:
    """Tune estimators on the passes of known mass in bags, and write a parameter file.

    The file contains the tuned parameters and those parameters of `base` that differ from their
    defaults, and selects the first estimator. If `estimators` is None, all candidates are tuned,
    and compared with each other and with `base` on held-out passes. If `estimators` is None, the
    file contains only the best estimator, which may be the estimator of `base` without tuning.
    `budget` is the largest number of evaluations of each estimator at each speed. `n_jobs` is the
    number of processes, as in `run_jobs`. The accuracies are printed. Returns the number of bags
    that were skipped.

    Raises the exceptions of `read_passes`, `TuningError` if there are too few passes or an
    estimator cannot be tuned, and `OutputError` if the file cannot be written.
    """
    before = base
    as_untrained = base.segmenter if estimators is None else None
    read = read_passes(bags, lane, unchecked(base.segmenter), n_jobs, as_untrained)
    groups = group_by_speed(read.passes)
    base = replace(base, segmenter=stated_lag(read.passes, base.segmenter))
    if estimators is None:
        compared = tune(groups, CANDIDATES, base, budget=budget, n_jobs=n_jobs, skip_failing=True)
        compared = with_untrained(compared, group_by_speed(read.untrained), before)
        chosen, reason = choose(compared)
        best = {chosen: compared[chosen]}
        text = parameter_file(best, read.lines, compared=compared, reason=reason)
    else:
        tuned = tune(groups, estimators, base, budget=budget, n_jobs=n_jobs)
        text = parameter_file(tuned, read.lines)
    write_whole(output, text)
    print('\n'.join(accuracy_lines(text)))
    return read.broken
