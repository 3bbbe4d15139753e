# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Job that weighs one bag, on this machine or on a worker of a cluster."""

from collections import Counter
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
import hashlib
import json
import math
from pathlib import Path
from socket import gethostname
import traceback

from checkweigher_core.printable import one_line
from checkweigher_core.recording import Recording
from checkweigher_core.records import GRAMS, NANOSECONDS, Decision
from checkweigher_core.ros.ports import STAGES
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.averages import RunningMoments
from checkweigher_recording.archive.copying import local_bag
from checkweigher_recording.archive.digest import bag_digest
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import over_stretches
from checkweigher_recording.scratch import scratch_folder
from checkweigher_validation.accuracy.results import ItemResult, weigh_stretches
from checkweigher_validation.archive.program import Program, other_program, program
from checkweigher_validation.archive.results_file import (
    BagSummary,
    Origin,
    finish,
    write_results_file,
)
from checkweigher_validation.jobs import WorkerLostError, jobs_as_done


@dataclass(frozen=True)
class WeighJob:
    """Bag to weigh, and the parameters to use."""

    bag: str  # path or URL of the bag
    parameters: LineParameters
    lane: str | None  # namespace of the lane; it may be None if the bag has only one lane
    program: Program  # program that must weigh the bag; another program refuses the job
    known: str = ''  # SHA-256 of the bag whose results are stored already, or empty


@dataclass(frozen=True)
class Weighed:
    """Result of a job.

    The fields `file` and `problem` are empty if the stored results are still valid.
    """

    bag: str
    host: str  # name of the machine that ran the job, or empty if its process was killed
    summary: BagSummary | None = None
    file: bytes | None = None  # content of the Parquet file with the results
    problem: str = ''  # error message in one line, or empty
    broken: bool = False  # whether the content of the bag has caused the problem


def parameters_digest(parameters: LineParameters) -> str:
    """Return the SHA-256 digest of the parameters of all stages."""
    values = {stage: getattr(parameters, stage).as_mapping() for stage in STAGES}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def origin_of(job: WeighJob, digest: str) -> Origin:
    """Return the origin of the results of a job. `digest` is the SHA-256 digest of its bag."""
    return Origin(digest, parameters_digest(job.parameters), job.lane or '', str(job.program))


def weigh_bag(job: WeighJob) -> Weighed:
    """Weigh a bag in limited memory.

    A bag with the digest `job.known` is not weighed again. An exception is returned as a `Weighed`
    with a problem.
    """
    broken = False
    try:
        if other := other_program(program(), job.program):
            return Weighed(job.bag, gethostname(), problem=f'{job.bag}: not weighed: {other}')
        with local_bag(job.bag) as bag:
            digest = bag_digest(bag)
            if digest == job.known:
                return Weighed(job.bag, gethostname())
            # From here on, an error is a fault of the bag, except an OSError or a MemoryError.
            broken = True
            summary, file = _weigh(job, bag, digest)
            return Weighed(job.bag, gethostname(), summary, file)
    except BagError as error:
        problem = str(error)
    except (OSError, MemoryError) as error:
        problem, broken = f'{job.bag}: {error or "not enough memory for this"}', False
    # Catch all exceptions, because a bug that appears with one bag must not end the other jobs.
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        problem = (
            f'{job.bag}: {type(error).__name__}: {error}, at line {place.lineno} of '
            f'{Path(place.filename).name}; report this with the bag'
        )
    return Weighed(job.bag, gethostname(), problem=one_line(problem), broken=broken)


def weigh_bags(
    jobs: Sequence[WeighJob], n_jobs: int | None = None
) -> Generator[Weighed, None, None]:
    """Weigh bags in parallel, and yield the result of each bag when it is done.

    If the process of a job is killed twice, the result contains a problem, and the other bags are
    still weighed. `n_jobs` is the number of processes, by default one for each core.

    Raises `ClusterLostError` if the jobs ran on a cluster that was lost.
    """
    with closing(jobs_as_done([partial(weigh_bag, job) for job in jobs], n_jobs)) as done:
        for number, found in done:
            if isinstance(found, WorkerLostError):
                bag = jobs[number].bag
                yield Weighed(bag, '', problem=one_line(f'{bag}: not weighed: {found}'))
            else:
                yield found


def _weigh(job: WeighJob, bag: Path, digest: str) -> tuple[BagSummary, bytes]:
    with scratch_folder() as folder:
        path = folder / 'results.parquet'

        def work(stretches: Iterable[Recording]) -> BagSummary:
            tally = _Tally(f'{bag}: ')
            results = weigh_stretches(tally.stretches(stretches), job.parameters)
            writer = write_results_file(path, tally.results(results))
            finish(writer, origin_of(job, digest), tally.summary())
            return tally.summary()

        return over_stretches(work, bag, job.lane), path.read_bytes()


@dataclass
class _Tally:
    """Accumulator for the summary of a bag."""

    name: str  # prefix that is removed from warnings
    begin: int | None = None  # time of the first sample in ns
    end: int = 0  # end of the last sample in ns
    decisions: Counter[Decision] = field(default_factory=Counter)
    errors: RunningMoments = field(default_factory=RunningMoments)  # errors of the masses in g
    notes: list[str] = field(default_factory=list)

    def stretches(self, stretches: Iterable[Recording]) -> Iterator[Recording]:
        """Yield the parts of a recording, and add their times and warnings."""
        for stretch in stretches:
            if len(stretch.blocks):
                last = stretch.blocks[-1]
                length = len(last.counts) / stretch.load_cell.sample_rate
                self.begin = stretch.blocks[0].stamp if self.begin is None else self.begin
                self.end = last.stamp + round(length * NANOSECONDS)
            if stretch.warning:
                self.notes.append(stretch.warning.removeprefix(self.name))
            yield stretch

    def results(self, results: Iterable[ItemResult]) -> Iterator[ItemResult]:
        """Yield the results of items, and add their decisions and errors."""
        for result in results:
            self.decisions[result.verdict.decision] += 1
            if not math.isnan(result.error):
                self.errors.add(GRAMS * result.error)
            yield result

    def summary(self) -> BagSummary:
        """Return the summary of all added results."""
        errors = self.errors
        return BagSummary(
            duration_s=(self.end - (self.begin or 0)) / NANOSECONDS,
            items=self.decisions.total(),
            accept=self.decisions[Decision.ACCEPT],
            under=self.decisions[Decision.UNDER],
            over=self.decisions[Decision.OVER],
            fault=self.decisions[Decision.FAULT],
            mean_error_g=errors.mean if errors.count else None,
            std_dev_g=errors.std_dev if errors.count > 1 else None,
            largest_error_g=errors.largest if errors.count else None,
            notes=tuple(self.notes),
        )
