# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Independent jobs side by side, by joblib.

In a ``joblib.parallel_config`` block the same jobs run on the backend that it names.
"""

from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import ExitStack, closing, contextmanager
from multiprocessing import resource_tracker
import os
import signal
import threading
from typing import Any
import warnings

from joblib import Parallel, delayed, effective_n_jobs

from checkweigher_dsp.parent_process import end_with_parent
from checkweigher_recording.progress import with_progress

ALL_CORES = -1  # as joblib takes it
_MOST_LOSSES = 3  # of processes, one after the other

# All cores have a worker: more threads of a matrix library only stand in each other's way. The
# parameter of joblib for it, inner_max_num_threads, would tie the jobs to one backend.
_ENVIRONMENT = {
    'OMP_NUM_THREADS': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'MKL_NUM_THREADS': '1',
    # Its tracker cleans up after killed workers without a warning.
    'PYTHONWARNINGS': 'ignore::UserWarning:joblib.externals.loky.backend.resource_tracker',
}


class WorkerLostError(ValueError):
    """A process that died at its work."""


class ClusterLostError(ValueError):
    """A cluster that has ended, or cannot be reached any more."""


def run_jobs(
    calls: Sequence[Any], n_jobs: int | None = None, doing: str = '', unit: str = 'steps'
) -> list[Any]:
    """Make independent calls, and return their results in the same order.

    There is a bar on a terminal if they take more than a second.

    Parameters
    ----------
    calls : sequence
        Of ``joblib.delayed(function)(...)``; arguments and results are pickled.
    n_jobs : int, optional
        Processes, as joblib takes it: `ALL_CORES` for one each; by default as many as the active
        ``joblib.parallel_config`` says, without one this process alone.
    doing, unit : str
        Label of the bar, and the unit of its counts.

    Raises
    ------
    WorkerLostError
        If a process was killed.
    ClusterLostError
        If the jobs were done by a cluster, and it has ended.
    """
    with closing(_results(calls, n_jobs, 'generator')) as results:
        return list(with_progress(results, doing, len(calls), unit=unit))


def jobs_as_done(
    calls: Sequence[Any], n_jobs: int | None = None
) -> Generator[tuple[int, Any], None, None]:
    """Make independent calls; yield the number and the result of each as soon as it is done.

    A call whose process is killed is made again. The parameters are those of `run_jobs`.

    Raises
    ------
    WorkerLostError
        If processes are killed again and again, and no call is done in between.
    """
    left = dict(enumerate(calls))
    losses = 0
    while left:
        numbered = [delayed(_numbered)(number, call) for number, call in left.items()]
        try:
            with closing(_results(numbered, n_jobs, 'generator_unordered')) as results:
                for number, result in results:
                    del left[number]
                    losses = 0
                    yield number, result
        except WorkerLostError:
            losses += 1
            if losses == _MOST_LOSSES:
                raise


def _numbered(number: int, call: Any) -> tuple[int, Any]:
    function, positional, named = call
    return number, function(*positional, **named)


def _results(calls: Sequence[Any], n_jobs: int | None, order: str) -> Generator[Any, None, None]:
    """Yield the results of calls as joblib returns them."""
    n_jobs = min(effective_n_jobs(n_jobs), max(len(calls), 1))
    with (
        _worker_environment(),
        _silent_end(),
        Parallel(
            n_jobs=n_jobs,
            return_as=order,
            initializer=end_with_parent,
            initargs=(os.getpid(),),
        ) as parallel,  # fmt: skip
        ExitStack() as at_the_end,
    ):
        with _interrupts_held_back():
            results = parallel(calls)
            at_the_end.callback(_end, results)
        try:
            yield from results
        except BrokenExecutor:
            raise WorkerLostError(
                'a worker process was killed, perhaps for lack of memory; try with --jobs 1'
            ) from None
        except Exception as error:
            lost = _lost_in_cluster(error)
            if lost is None:
                raise
            raise lost from None


def _lost_in_cluster(error: Exception) -> ValueError | None:
    """Return the one line for an error of dask.distributed itself, which need not be installed."""
    kind = type(error)
    if not kind.__module__.startswith('distributed.'):
        return None
    if kind.__name__ == 'KilledWorker':  # several, one after the other
        return WorkerLostError(
            'workers of the cluster were killed, perhaps for lack of memory; see their logs'
        )
    text = ' '.join(str(error).split()) or kind.__name__
    return ClusterLostError(f'the cluster was lost: {text}')


def _end(results: Generator[Any]) -> None:
    """End the workers if there are results to come."""
    with _interrupts_held_back():
        results.close()


@contextmanager
def _worker_environment() -> Iterator[None]:
    """Set the environment of processes that start within."""
    kept = {name: os.environ.get(name) for name in _ENVIRONMENT}
    os.environ.update(_ENVIRONMENT)
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Have signals wait until the end of the block; processes that start within take no Ctrl-C.

    This process ends them. One that is interrupted itself, at its imports for example, would say
    so with a traceback, and one that is interrupted as it starts another leaves it half started.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    resource_tracker.ensure_running()  # else the first worker starts it, which unblocks SIGINT
    came: list[int] = []
    # A thread of a matrix library may take the signal though it is blocked here, hence a handler.
    handlers = {
        number: signal.signal(number, lambda number, frame: came.append(number))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for each in came:
        signal.raise_signal(each)


@contextmanager
def _silent_end() -> Iterator[None]:
    """Silence joblib where calls are given up.

    It warns of their number, and the thread that hands them out misses those that are left.
    """

    def say(arguments: threading.ExceptHookArgs) -> None:
        if arguments.exc_type is not KeyError:
            hook(arguments)

    hook, threading.excepthook = threading.excepthook, say
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings('ignore', r'\d+ tasks which', UserWarning)
            yield
    finally:
        threading.excepthook = hook
