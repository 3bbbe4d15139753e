# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parallel execution of independent jobs on this machine or on a cluster."""

from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
import os
import signal
from typing import Any

from checkweigher_core.parent_process import end_with_parent
from checkweigher_recording.progress import with_progress

Job = Callable[[], Any]

# Environment variables that limit the numerical libraries of a worker process to one thread. By
# default there is a worker for each core, so more threads would slow down the other workers.
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1'}
_LOOK = 5.0  # time in s without a finished job after which the workers are checked


class WorkerLostError(ValueError):
    """Error of a job whose worker was killed twice, the second time while no other job was running.

    `run_jobs` raises the error, and `jobs_as_done` yields it as the result of the job.
    """


class ClusterLostError(ValueError):
    """Raised if a cluster in use has ended, has no workers any more, or cannot be reached."""


class Workers(AbstractContextManager['Workers']):
    """Context manager of worker processes that run jobs.

    If an exception leaves the context, all jobs that have not ended are cancelled.
    """

    ahead: int  # largest number of submitted jobs that are not done yet.
    # Exception that the future of a job raises if its worker was killed, perhaps by another job.
    lost: type[Exception]

    @abstractmethod
    def submit(self, job: Job, alone: bool) -> Future[Any]:
        """Submit a job, and return its future.

        The caller sets `alone` to True only if no other job is running.
        """

    def check(self) -> None:
        """Raise `ClusterLostError` if the workers belong to a cluster that was lost.

        By default, this method does nothing.
        """


class _Processes(Workers):
    """Processes on this machine, which are reused for later jobs."""

    lost = BrokenExecutor

    def __init__(self, count: int) -> None:
        self._count = count
        self.ahead = 2 * count
        self._executor: Any = None

    def submit(self, job: Job, alone: bool) -> Future[Any]:
        from loky import get_reusable_executor  # imported late, because the import is slow

        with _mute():
            while True:
                # If a process of the executor was killed, `submit` raises `BrokenExecutor`. In this
                # case, try again, because `get_reusable_executor` then returns a new executor.
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
    """In this context, redirect stderr to the null device, also for new processes.

    Otherwise, a process that Ctrl-C interrupts during its imports would print a traceback.
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
    # Ignore Ctrl-C, because the parent process ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent(parent)


_ELSEWHERE: ContextVar[Callable[[], Workers] | None] = ContextVar('elsewhere', default=None)


@contextmanager
def jobs_done_by(workers: Callable[[], Workers]) -> Iterator[None]:
    """In this context, run jobs on other workers instead of processes on this machine.

    `workers` is called for each set of jobs, and returns the workers for it.
    """
    token = _ELSEWHERE.set(workers)
    try:
        yield
    finally:
        _ELSEWHERE.reset(token)


def run_jobs(
    jobs: Sequence[Job],
    n_jobs: int | None = None,
    doing: str = '',
    sizes: Sequence[float] | None = None,
) -> list[Any]:
    """Run independent jobs, and return their results in the same order.

    A job is a function without parameters (see `functools.partial`). Jobs and results must be
    picklable. `n_jobs` is the number of processes on this machine, by default one for each core. If
    `n_jobs` is 1, or if there is only one job, this process runs the jobs. In the context of
    `jobs_done_by`, `n_jobs` is ignored. On a terminal, a progress bar with the label `doing` is
    shown. The progress bar uses `sizes`, which are proportional to the expected times of the jobs,
    and equal by default. An exception of a job is raised again, and the remaining jobs are
    cancelled.

    Raises `WorkerLostError` if the worker of a job was killed twice, the second time while the job
    ran alone, and `ClusterLostError` if the jobs ran on a cluster that was lost.
    """
    with closing(jobs_as_done(jobs, n_jobs)) as results:
        if sizes is None:
            found = dict(with_progress(results, doing, len(jobs)))
        else:
            shares = [size / sum(sizes) for size in sizes]
            found = dict(with_progress(results, doing, 1.0, size=lambda result: shares[result[0]]))
    for result in found.values():
        if isinstance(result, WorkerLostError):
            raise result
    return [found[number] for number in range(len(jobs))]


def jobs_as_done(
    jobs: Sequence[Job], n_jobs: int | None = None
) -> Generator[tuple[int, Any], None, None]:
    """Run independent jobs, and yield the position and the result of each job when it is done.

    If a worker on this machine is killed, all submitted jobs that have not ended are run again, one
    at a time. If workers of a cluster are killed, the jobs that Dask has given up are run again,
    one at a time. If the worker of a job is killed again, the result of the job is a
    `WorkerLostError`. Any other exception of a job is raised again, and the remaining jobs are
    cancelled. The parameters are as in `run_jobs`.

    Raises `ClusterLostError` if the jobs ran on a cluster that was lost.
    """
    from loky import cpu_count  # imported late, because the import is slow

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
    """Run jobs, and yield the number and the result of each job when it is done.

    At most `at_once` jobs are submitted at a time. A result may be a `WorkerLostError`.
    """
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
