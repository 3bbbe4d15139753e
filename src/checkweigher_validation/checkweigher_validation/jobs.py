# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Independent jobs in parallel, by `concurrent.futures`, on this machine or on a cluster."""

from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
import os
import signal
from typing import Any

from loky import cpu_count, get_reusable_executor

from checkweigher_core.parent_process import end_with_parent
from checkweigher_recording.progress import with_progress

Job = Callable[[], Any]

# Each core has a worker, so further threads of a matrix library would only slow the others down.
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1'}
_LOOK = 5.0  # interval of the checks of the workers while no job is done, s


class WorkerLostError(ValueError):
    """A job that killed its worker twice, the second time when it ran alone."""


class ClusterLostError(ValueError):
    """A cluster that has ended, has no worker left, or cannot be reached any more."""


class Workers(AbstractContextManager['Workers']):
    """Processes that do jobs. An error in the block cancels the jobs that are not done."""

    ahead: int  # number of jobs that are submitted at the same time
    lost: type[Exception]  # raised by a job whose worker was killed, perhaps by another job

    @abstractmethod
    def submit(self, job: Job, alone: bool) -> Future[Any]:
        """Submit a job; if `alone`, no other job may run."""

    def check(self) -> None:
        """Raise ClusterLostError if no further job will be done."""


class _Processes(Workers):
    """Processes of this machine, which are reused for later jobs."""

    lost = BrokenExecutor

    def __init__(self, count: int) -> None:
        self._count = count
        self.ahead = 2 * count
        self._executor: Any = None

    def submit(self, job: Job, alone: bool) -> Future[Any]:
        with _mute():
            while True:
                # This makes a new executor if a process of the last one was killed.
                self._executor = get_reusable_executor(
                    1 if alone else self._count,
                    timeout=None,
                    kill_workers=True,
                    env=ONE_THREAD,
                    initializer=_begin_worker,
                    initargs=(os.getpid(),),
                )
                with suppress(BrokenExecutor):
                    future: Future[Any] = self._executor.submit(job)
                    return future

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and self._executor is not None:
            self._executor.shutdown(kill_workers=True)


@contextmanager
def _mute() -> Iterator[None]:
    """Discard the error output of processes that start in this block.

    Ctrl-C reaches all processes of the terminal, and a process that is interrupted during its
    imports would print a traceback.
    """
    kept = os.dup(2)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(null)


def _begin_worker(parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends it
    end_with_parent(parent)


_ELSEWHERE: ContextVar[Callable[[], Workers] | None] = ContextVar('elsewhere', default=None)


@contextmanager
def jobs_done_by(workers: Callable[[], Workers]) -> Iterator[None]:
    """Run the jobs of this block on other workers instead of processes of this machine."""
    token = _ELSEWHERE.set(workers)
    try:
        yield
    finally:
        _ELSEWHERE.reset(token)


def run_jobs(
    jobs: Sequence[Job], n_jobs: int | None = None, doing: str = '', unit: str = 'steps'
) -> list[Any]:
    """Run independent jobs, and return their results in the same order.

    Jobs are called without arguments (see `functools.partial`); jobs and results are pickled.
    `n_jobs` is the number of processes on this machine, by default one for each core; with 1, this
    process runs the jobs. A bar labelled `doing` is shown on a terminal if they take more than a
    second.

    Raises `WorkerLostError` if a job killed its worker, also when it was tried alone, and
    `ClusterLostError` if a cluster does the jobs and is lost.
    """
    with closing(jobs_as_done(jobs, n_jobs)) as results:
        found = dict(with_progress(results, doing, len(jobs), unit=unit))
    for result in found.values():
        if isinstance(result, WorkerLostError):
            raise result
    return [found[number] for number in range(len(jobs))]


def jobs_as_done(
    jobs: Sequence[Job], n_jobs: int | None = None
) -> Generator[tuple[int, Any], None, None]:
    """Run independent jobs; yield the number and the result of each as soon as it is done.

    If a worker is killed, the jobs that were submitted at that time are tried again, one at a time.
    The result of a job that kills its worker again is a `WorkerLostError`. The parameters are as in
    `run_jobs`.

    Raises `ClusterLostError` if the jobs were done by a cluster, and it was lost.
    """
    count = min(n_jobs or cpu_count(), len(jobs))
    elsewhere = _ELSEWHERE.get()
    if elsewhere is None and count <= 1:
        for number, job in enumerate(jobs):
            yield number, job()
        return
    with _Processes(count) if elsewhere is None else elsewhere() as workers:
        again: dict[int, Job] = {}
        for number, result in _results(workers, dict(enumerate(jobs)), workers.ahead):
            if isinstance(result, WorkerLostError):
                again[number] = jobs[number]
            else:
                yield number, result
        yield from _results(workers, again, 1)


def _results(
    workers: Workers, jobs: Mapping[int, Job], at_once: int
) -> Generator[tuple[int, Any], None, None]:
    """Run jobs and yield numbers and results; a result is a WorkerLostError if its worker died."""
    left = iter(jobs.items())
    running: dict[Future[Any], int] = {}
    while True:
        for number, job in islice(left, at_once - len(running)):
            running[workers.submit(job, alone=at_once == 1)] = number
        if not running:
            return
        done, _ = wait(running, _LOOK, FIRST_COMPLETED)
        if not done:
            workers.check()
        for future in done:
            try:
                result = future.result()
            except workers.lost:
                result = WorkerLostError(
                    'the job killed its worker, and again when it was tried alone, perhaps for '
                    'lack of memory'
                )
            yield running.pop(future), result
