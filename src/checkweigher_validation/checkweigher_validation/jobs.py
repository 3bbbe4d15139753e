# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Independent jobs side by side: by joblib on this machine, or on the workers of a cluster.

In a ``joblib.parallel_config`` block the same jobs run on the backend that it names, in an
`on_cluster` block on that cluster.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
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
from checkweigher_validation.cluster import WorkerLostError, active_cluster

ALL_CORES = -1  # as joblib takes it

# All cores have a worker: more threads of a matrix library only stand in each other's way. The
# parameter of joblib for it, inner_max_num_threads, would tie the jobs to one backend.
_ENVIRONMENT = {
    'OMP_NUM_THREADS': '1',
    'OPENBLAS_NUM_THREADS': '1',
    'MKL_NUM_THREADS': '1',
    # Its tracker cleans up after killed workers without a warning.
    'PYTHONWARNINGS': 'ignore::UserWarning:joblib.externals.loky.backend.resource_tracker',
}


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
        If a process was killed; on a cluster, if Dask gave up a call since it killed several.
    ClusterLostError
        If the jobs were done by a cluster, and it was lost.
    """
    numbered = dict(enumerate(calls))
    cluster = active_cluster()
    results = _here(numbered, n_jobs) if cluster is None else cluster.results(numbered)
    with closing(results):
        found = dict(with_progress(_none_lost(results), doing, len(calls), unit=unit))
    return [found[number] for number in numbered]


def _none_lost(results: Iterable[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
    for number, result in results:
        if isinstance(result, WorkerLostError):
            raise result
        yield number, result


def jobs_as_done(
    calls: Sequence[Any], n_jobs: int | None = None
) -> Generator[tuple[int, Any], None, None]:
    """Make independent calls; yield the number and the result of each as soon as it is done.

    The result of a call that kills its process is a `WorkerLostError`; the others are made. The
    parameters are those of `run_jobs`.

    Raises
    ------
    ClusterLostError
        If the jobs were done by a cluster, and it was lost.
    """
    left = dict(enumerate(calls))
    if (cluster := active_cluster()) is not None:
        yield from cluster.results(left)
        return
    while left:
        begun: set[int] = set()
        try:
            with closing(_here(left, n_jobs, begun)) as results:
                for number, result in results:
                    del left[number]
                    yield number, result
        except WorkerLostError:
            # Any of those that were begun may have done it: each has a process of its own now.
            for number in sorted(begun.intersection(left)):
                yield number, _alone(left.pop(number))


def _alone(call: Any) -> Any:
    """Return the result of a call in another process, a WorkerLostError if that is killed."""
    try:
        with closing(_here({0: call}, 2, at_least=2)) as results:
            ((_, result),) = results
    except WorkerLostError:
        return WorkerLostError('its process was killed, perhaps for lack of memory')
    return result


def _numbered(number: int, call: Any) -> tuple[int, Any]:
    function, positional, named = call
    return number, function(*positional, **named)


def _here(
    calls: Mapping[int, Any], n_jobs: int | None, begun: set[int] | None = None, at_least: int = 1
) -> Generator[tuple[int, Any], None, None]:
    """Yield numbers and results of calls on this machine as they are done.

    The numbers of calls that are handed out are added to `begun`. Of one process, joblib makes the
    calls in this one: `at_least` two makes another for a single call.
    """
    handed_out = set() if begun is None else begun

    def numbered() -> Iterator[Any]:
        for number, call in list(calls.items()):  # the caller may drop those that are done
            handed_out.add(number)
            yield delayed(_numbered)(number, call)

    n_jobs = min(effective_n_jobs(n_jobs), max(len(calls), at_least))
    with (
        _worker_environment(),
        _silent_end(),
        Parallel(
            n_jobs=n_jobs,
            return_as='generator_unordered',
            initializer=end_with_parent,
            initargs=(os.getpid(),),
        ) as parallel,  # fmt: skip
        ExitStack() as at_the_end,
    ):
        try:
            with _interrupts_held_back():
                results = parallel(numbered())
                at_the_end.callback(_end, results)
            yield from results
        except BrokenExecutor:
            raise WorkerLostError(
                'a worker process was killed, perhaps for lack of memory; try with --jobs 1'
            ) from None


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
