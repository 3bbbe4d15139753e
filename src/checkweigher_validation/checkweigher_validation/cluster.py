# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Independent jobs on the workers of a Dask cluster; dask.distributed need not be installed.

The Dask backend of joblib is not used: it never hands on that a job was given up.
"""

from collections.abc import Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import islice
import time
from typing import Any

_AHEAD = 5000  # jobs at the scheduler: enough for any cluster, and no year of bags in its memory
_POLL = 0.02  # s
_LOOK = 5.0  # s, between looks at the workers while no job is done
_PATIENCE = 60.0  # s, for a worker to come back if all have ended


class WorkerLostError(ValueError):
    """A process that died at its work."""


class ClusterLostError(ValueError):
    """A cluster that has ended, has no worker any more, or cannot be reached any more."""


class Cluster:
    """The workers of a cluster.

    Parameters
    ----------
    client : distributed.Client
        Of its scheduler.
    workers : sequence of str, optional
        Addresses of those that may be used; by default all, also those that come later.
    """

    def __init__(self, client: Any, workers: Iterable[str] | None = None) -> None:
        self._client = client
        self._workers = None if workers is None else list(workers)

    def results(self, calls: Mapping[int, Any]) -> Generator[tuple[int, Any], None, None]:
        """Make calls; yield the number and the result of each as soon as it is done.

        A call that Dask gives up, since workers died at it one after the other, has a
        `WorkerLostError` for its result. Dask also blames one that only waited on those workers:
        if there are several such calls, each is made once more with nothing beside it.

        Raises
        ------
        ClusterLostError
            If the cluster has ended or cannot be reached any more.
        """
        suspects: dict[int, WorkerLostError] = {}
        for number, result in self._as_done(calls):
            if isinstance(result, WorkerLostError):
                suspects[number] = result
            else:
                yield number, result
        for number, error in suspects.items():
            if len(suspects) == 1:
                yield number, error
            else:
                yield from self._as_done({number: calls[number]})

    def _as_done(self, calls: Mapping[int, Any]) -> Generator[tuple[int, Any], None, None]:
        from distributed import CancelledError, KilledWorker, as_completed

        done = as_completed([], loop=self._client.loop)
        numbers: dict[Any, int] = {}
        left = iter(calls.items())
        try:
            while self._submit(islice(left, _AHEAD - len(numbers)), numbers, done) or numbers:
                for future in self._batch(done):
                    try:
                        result = future.result(timeout=_LOOK)
                    except KilledWorker:
                        result = WorkerLostError(
                            'workers of the cluster were killed at it one after the other, '
                            'perhaps for lack of memory; see their logs'
                        )
                    except TimeoutError:
                        if future.status == 'error':  # of the call
                            raise
                        done.add(future)  # its worker has died since, and another one makes it
                        continue
                    yield numbers.pop(future), result
        except Exception as error:
            of_dask = type(error).__module__.startswith('distributed.')
            if not of_dask and not isinstance(error, CancelledError):
                raise
            text = ' '.join(str(error).split()) or type(error).__name__
            raise ClusterLostError(f'the cluster was lost: {text}') from None
        finally:
            for future in numbers:  # of an iteration that is given up
                future.release()

    def _submit(self, calls: Iterable[tuple[int, Any]], numbers: dict[Any, int], done: Any) -> bool:
        """Submit calls and add their numbers, by their futures; tell whether there were any."""
        before = len(numbers)
        for number, (function, positional, named) in calls:
            # As one piece: Dask would search the arguments for its own objects.
            call = partial(function, *positional, **named)
            future = self._client.submit(call, pure=False, workers=self._workers)
            numbers[future] = number
            done.add(future)
        return len(numbers) > before

    def _batch(self, done: Any) -> list[Any]:
        """Wait for jobs to be done, and return their futures."""
        look = time.monotonic() + _LOOK
        gone: float | None = None  # the time at which there was no worker first
        while not (batch := done.next_batch(block=False)):
            time.sleep(_POLL)
            now = time.monotonic()
            if now < look:
                continue
            look = now + _LOOK
            if self._has_worker():
                gone = None
            elif gone is None:
                gone = now
            elif now > gone + _PATIENCE:
                raise ClusterLostError(
                    f'the cluster was lost: it has had no worker for {_PATIENCE:.0f} s'
                )
        return list(batch)

    def _has_worker(self) -> bool:
        """Tell whether a worker is there that may be used; True if the scheduler does not say."""
        try:
            there = self._client.scheduler_info(n_workers=-1)['workers']
        except (OSError, TimeoutError):
            return True  # what becomes of the connection, the jobs tell
        return bool(there if self._workers is None else set(there).intersection(self._workers))


_ACTIVE: ContextVar[Cluster | None] = ContextVar('cluster', default=None)


@contextmanager
def on_cluster(cluster: Cluster) -> Iterator[None]:
    """Have the jobs of `checkweigher_validation.jobs` done by a cluster in this block."""
    token = _ACTIVE.set(cluster)
    try:
        yield
    finally:
        _ACTIVE.reset(token)


def active_cluster() -> Cluster | None:
    """Return the cluster of the `on_cluster` block, if any."""
    return _ACTIVE.get()
