# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Jobs on the workers of a Dask cluster; dask.distributed is optional."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from functools import partial
import logging
import time
from typing import Any
import warnings

from checkweigher_core.printable import one_line
from checkweigher_validation.jobs import ClusterLostError, Job, Workers, jobs_done_by

LOCAL = 'local'
_ANSWER = 10.0  # s, for the scheduler to answer
_PATIENCE = 60.0  # s, for a worker to come back if all have ended
_UNREACHABLE = 'its scheduler has ended, or cannot be reached any more'


class SchedulerError(ValueError):
    """A cluster that cannot be used. The message has its address, the reason and advice."""


class _Cluster(Workers):
    """Workers of a cluster with the given addresses, or all workers, including later ones."""

    ahead = 5000  # enough for any cluster, with little memory in its scheduler

    def __init__(self, client: Any, addresses: Sequence[str] | None) -> None:
        from distributed import KilledWorker

        self.lost = KilledWorker
        self._client = client
        self._addresses = addresses
        self._executor: Executor = client.get_executor(pure=False, workers=addresses)
        self._gone: float | None = None  # time since which there has been no worker

    def submit(self, job: Job, alone: bool) -> Future[Any]:
        return self._executor.submit(job)

    def check(self) -> None:
        try:
            there = self._client.scheduler_info(n_workers=-1)['workers']
        except (OSError, TimeoutError):
            return  # the jobs will fail if the connection is lost
        if self._client.status == 'closed':
            raise ClusterLostError(f'the cluster was lost: {_UNREACHABLE}')
        now = time.monotonic()
        if there if self._addresses is None else set(there).intersection(self._addresses):
            self._gone = None
        elif self._gone is None:
            self._gone = now
        elif now > self._gone + _PATIENCE:
            raise ClusterLostError(
                f'the cluster was lost: it has had no worker for {_PATIENCE:.0f} s'
            )

    def __exit__(self, kind: type[BaseException] | None, error: Any, _: object) -> None:
        if kind is None:
            return
        if kind.__module__.startswith('distributed.') or issubclass(kind, CancelledError):
            raise ClusterLostError(
                f'the cluster was lost: {one_line(error) or _UNREACHABLE}'
            ) from None
        self._executor.shutdown(wait=False)


@contextmanager
def on_scheduler(
    address: str, question: Callable[[], Any], refusal: Callable[[Any], str]
) -> Iterator[list[str]]:
    """Run the jobs of `checkweigher_validation.jobs` on a scheduler.

    `address` is 'local' for processes of this machine, or the address of a Dask scheduler, for
    example 'tcp://HOST:8786'. Each worker of a cluster calls `question`, and its answer is pickled.
    `refusal` gets the answer and returns why the worker is not used, in one line, or an empty text.

    Yields a line for each worker that is refused. The others do the jobs.

    Raises `SchedulerError` if dask.distributed is not installed, the cluster does not answer, or no
    worker is left.
    """
    if address == LOCAL:
        yield []
        return
    with _client(address) as client:
        refused = _refused(client, question, refusal)
        there = client.scheduler_info(n_workers=-1)['workers']
        workers = [name for name in there if name not in refused]
        if not workers:
            lines = '; '.join(refused.values()) or 'it has no worker; start "dask worker" there'
            raise SchedulerError(f'{address}: {lines}')
        # Name addresses only if some are refused, because a restarted worker has another address.
        with jobs_done_by(partial(_Cluster, client, workers if refused else None)):
            yield list(refused.values())


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        import distributed
    except ImportError:
        raise SchedulerError(
            f'--scheduler {address}: dask.distributed is not installed; pip install distributed'
        ) from None
    # The client logs tracebacks while it reconnects, but raises the exceptions as well.
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        # Tuning sends passes of known mass, which are large.
        warnings.filterwarnings('ignore', 'Sending large graph', UserWarning)
        try:
            client = distributed.Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            text = one_line(error) or type(error).__name__
            raise SchedulerError(
                f'--scheduler {address}: no Dask scheduler there: {text}'
            ) from None
        with client:
            yield client


def _refused(
    client: Any, question: Callable[[], Any], refusal: Callable[[Any], str]
) -> dict[str, str]:
    refused = {}
    for name, answer in client.run(question, on_error='return').items():
        # A connection error of Dask has no errno: the worker has ended meanwhile, and its
        # replacement has another address.
        if isinstance(answer, OSError) and answer.errno is None:
            continue
        is_error = isinstance(answer, BaseException)
        why = f'cannot run this program: {one_line(answer)}' if is_error else refusal(answer)
        if why:
            refused[name] = f'worker {name} is not used: {why}'
    return refused
