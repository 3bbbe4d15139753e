# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Jobs on the workers of a Dask cluster. The package dask.distributed is optional."""

from collections.abc import Iterator, Sequence
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager
from functools import partial
import logging
import time
from typing import Any
import warnings

from checkweigher_core.printable import one_line
from checkweigher_validation.archive.program import other_program, program
from checkweigher_validation.jobs import ClusterLostError, Job, Workers, jobs_done_by

LOCAL = 'local'
_ANSWER = 10.0  # longest time to wait for an answer from the scheduler in s
_PATIENCE = 60.0  # longest time without any worker in s
_UNREACHABLE = 'its scheduler has ended, or cannot be reached any more'


class SchedulerError(ValueError):
    """Raised if a cluster cannot be used.

    The message contains the address of the scheduler and the reason.
    """


class _Cluster(Workers):
    """Workers of a cluster at the given addresses, or all workers if `addresses` is None."""

    # The limit of submitted jobs exceeds the number of workers, so that no worker waits for a job.
    # A limit is necessary, because the scheduler keeps the submitted jobs in memory.
    ahead = 5000

    def __init__(self, client: Any, addresses: Sequence[str] | None) -> None:
        from distributed import KilledWorker

        self.lost = KilledWorker
        self._client = client
        self._addresses = addresses
        self._executor: Executor = client.get_executor(pure=False, workers=addresses)
        # Monotonic time in s since which no check has found a worker. The time is None before the
        # first check, and if the last check found a worker.
        self._gone: float | None = None

    def submit(self, job: Job, alone: bool) -> Future[Any]:
        return self._executor.submit(job)

    def check(self) -> None:
        try:
            there = self._client.scheduler_info(n_workers=-1)['workers']
        except (OSError, TimeoutError):
            return  # ignored here, because the jobs themselves report a lost connection
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
def on_scheduler(address: str) -> Iterator[list[str]]:
    """In this context, run jobs (see `checkweigher_validation.jobs`) on the workers of a cluster.

    `address` is 'local' for processes of this machine, or the address of a Dask scheduler, for
    example 'tcp://HOST:8786'. Workers are not used if their program differs from the program of
    this process, or if they cannot report their program.

    Yields a list with a line for each worker that is not used. The list is empty if all workers are
    used, or if `address` is 'local'.

    Raises `SchedulerError` if dask.distributed is not installed, the scheduler does not answer, or
    no worker can be used.
    """
    if address == LOCAL:
        yield []
        return
    with _client(address) as client:
        refused = _refused(client)
        there = client.scheduler_info(n_workers=-1)['workers']
        workers = [name for name in there if name not in refused]
        if not workers:
            lines = '; '.join(refused.values()) or 'it has no worker; start "dask worker" there'
            raise SchedulerError(f'{address}: {lines}')
        # If all workers can be used, do not restrict the jobs to their addresses, because a
        # restarted worker has another address.
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
    # Suppress the log of the client, because it contains tracebacks of exceptions that the client
    # also raises.
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        # Suppress the warning about large jobs. The jobs of tuning are large because each of them
        # contains the passes.
        warnings.filterwarnings('ignore', 'Sending large graph', UserWarning)
        try:
            client = distributed.Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            text = one_line(error) or type(error).__name__
            raise SchedulerError(
                f'--scheduler {address}: there is no Dask scheduler: {text}'
            ) from None
        with client:
            yield client


def _refused(client: Any) -> dict[str, str]:
    """Return a line for each worker that cannot be used, by the address of the worker."""
    here, refused = program(), {}
    for name, answer in client.run(program, on_error='return').items():
        # Ignore a worker that has ended, for which Dask returns a connection error without an
        # errno.
        if isinstance(answer, OSError) and answer.errno is None:
            continue
        is_error = isinstance(answer, BaseException)
        failure = f'cannot run this program: {one_line(answer)}' if is_error else ''
        if why := failure or other_program(answer, here):
            refused[name] = f'worker {name} is not used: {why}'
    return refused
