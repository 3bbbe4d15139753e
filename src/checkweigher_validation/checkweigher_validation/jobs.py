# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Independent jobs side by side, by `concurrent.futures`: on this machine, or on a cluster."""

from abc import abstractmethod
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor, Future
from contextlib import AbstractContextManager, closing, contextmanager, suppress
from contextvars import ContextVar
from itertools import islice
import os
from queue import Empty, SimpleQueue
import signal
from typing import Any

from loky import cpu_count, get_reusable_executor

from checkweigher_core.parent_process import end_with_parent
from checkweigher_recording.progress import with_progress

Job = Callable[[], Any]

# All cores have a worker: more threads of a matrix library only stand in each other's way.
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1', 'MKL_NUM_THREADS': '1'}
_LOOK = 5.0  # s, between looks at the workers while no job is done


class WorkerLostError(ValueError):
    """A job that killed its worker, and did so again when it was tried alone."""


class ClusterLostError(ValueError):
    """A cluster that has ended, has no worker any more, or cannot be reached any more."""


class Workers(AbstractContextManager['Workers']):
    """Processes that do jobs; at an error in the block, jobs that are not done are given up."""

    ahead: int  # jobs that are submitted at once
    lost: type[Exception]  # of a job whose worker was killed, perhaps by another job

    @abstractmethod
    def submit(self, job: Job, alone: bool) -> Future[Any]:
        """Submit a job, perhaps one that is to be alone on all workers."""

    def check(self) -> None:
        """Raise ClusterLostError if no job will be done any more."""


class _Processes(Workers):
    """Processes of this machine, which stay for later jobs."""

    lost = BrokenExecutor

    def __init__(self, count: int) -> None:
        self._count = count
        self.ahead = 2 * count
        self._executor: Any = None

    def submit(self, job: Job, alone: bool) -> Future[Any]:
        with _mute():
            while True:
                # Another one if a process of the last was killed.
                self._executor = get_reusable_executor(
                    1 if alone else self._count, timeout=None, kill_workers=True, env=ONE_THREAD,
                    initializer=_begin_worker, initargs=(os.getpid(),),
                )  # fmt: skip
                with suppress(BrokenExecutor):
                    future: Future[Any] = self._executor.submit(job)
                    return future

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and self._executor is not None:
            self._executor.shutdown(kill_workers=True)


@contextmanager
def _mute() -> Iterator[None]:
    """Discard the error output of processes that start in this block.

    Ctrl-C is for the whole terminal: one that is interrupted at its imports would say so with a
    traceback.
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
    """Run the jobs of this block on other workers than processes of this machine."""
    token = _ELSEWHERE.set(workers)
    try:
        yield
    finally:
        _ELSEWHERE.reset(token)


def run_jobs(
    jobs: Sequence[Job], n_jobs: int | None = None, doing: str = '', unit: str = 'steps'
) -> list[Any]:
    """Do independent jobs, and return their results in the same order.

    There is a bar on a terminal if they take more than a second.

    Parameters
    ----------
    jobs : sequence of callable
        With their arguments, as by `functools.partial`; they and their results are pickled.
    n_jobs : int, optional
        Processes of this machine, by default one for each core; 1 for this process alone.
    doing, unit : str
        Label of the bar, and the unit of its counts.

    Raises
    ------
    WorkerLostError
        If a job killed its worker, also when it was tried alone.
    ClusterLostError
        If the jobs were done by a cluster, and it was lost.
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
    """Do independent jobs; yield the number and the result of each as soon as it is done.

    The jobs that were with the workers when one of these was killed are tried again, one after the
    other with nothing beside them. The result of one that kills its worker again is a
    `WorkerLostError`. The parameters are those of `run_jobs`.

    Raises
    ------
    ClusterLostError
        If the jobs were done by a cluster, and it was lost.
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
    """Do jobs, so many at once; yield number and result, a WorkerLostError if a worker died."""
    left = iter(jobs.items())
    running: dict[Future[Any], int] = {}
    done: SimpleQueue[Future[Any]] = SimpleQueue()
    while True:
        for number, job in islice(left, at_once - len(running)):
            future = workers.submit(job, alone=at_once == 1)
            running[future] = number
            future.add_done_callback(done.put)
        if not running:
            return
        try:
            future = done.get(timeout=_LOOK)
        except Empty:
            workers.check()
            continue
        number = running.pop(future)
        try:
            result = future.result()
        except workers.lost:
            result = WorkerLostError(
                'the job killed its worker, and again when it was tried alone, perhaps for lack '
                'of memory'
            )
        yield number, result
