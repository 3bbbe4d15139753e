# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where jobs are done: on this machine, or on the workers of a Dask cluster."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import logging
from typing import Any
import warnings

from checkweigher_validation.cluster import Cluster, on_cluster

LOCAL = 'local'
_PATIENCE = 10.0  # s, for scheduler and workers to answer


class SchedulerError(ValueError):
    """A cluster that cannot be used; one line that says which, why, and what to do."""


@contextmanager
def on_scheduler(
    address: str, question: Callable[[], Any], refusal: Callable[[Any], str]
) -> Iterator[list[str]]:
    """Have the jobs of `checkweigher_validation.jobs` done by a scheduler.

    Parameters
    ----------
    address : str
        'local' for processes of this machine, or that of a Dask scheduler, as in
        'tcp://HOST:8786'.
    question : callable
        Answered by each worker of the cluster, with a value that can be pickled.
    refusal : callable
        Returns why a worker with this answer is not used, in one line, empty if it is.

    Yields
    ------
    list of str
        A line on each worker that is refused. The others do the jobs.

    Raises
    ------
    SchedulerError
        If dask.distributed is not installed, the cluster does not answer, or no worker is left.
    """
    if address == LOCAL:
        yield []
        return
    with _client(address) as client:
        refused = _refused(client, question, refusal)
        workers = [name for name in _workers(client) if name not in refused]
        if not workers:
            lines = '; '.join(refused.values()) or 'it has no worker; start "dask worker" there'
            raise SchedulerError(f'{address}: {lines}')
        # Only where some are refused: a worker that is started again has another address.
        with on_cluster(Cluster(client, workers if refused else None)):
            yield list(refused.values())


@contextmanager
def _client(address: str) -> Iterator[Any]:
    try:
        import distributed
    except ImportError:
        raise SchedulerError(
            f'--scheduler {address}: dask.distributed is not installed; pip install distributed'
        ) from None
    # What it logs with a traceback while it reconnects comes as an exception as well.
    logging.getLogger('distributed.client').setLevel(logging.CRITICAL)
    with warnings.catch_warnings():
        # Passes of known mass that tuning sends are large.
        warnings.filterwarnings('ignore', 'Sending large graph', UserWarning)
        try:
            client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            text = ' '.join(str(error).split()) or type(error).__name__
            raise SchedulerError(
                f'--scheduler {address}: no Dask scheduler there: {text}'
            ) from None
        with client:
            yield client


def _refused(
    client: Any, question: Callable[[], Any], refusal: Callable[[Any], str]
) -> dict[str, str]:
    """Return a line on each worker that is not to be used, by its address."""
    answers = client.run(question, on_error='return')
    refused = {}
    for name, answer in answers.items():
        if isinstance(answer, BaseException):
            why = f'cannot run this program: {" ".join(str(answer).split())}'
        else:
            why = refusal(answer)
        if why:
            refused[name] = f'worker {name} is not used: {why}'
    return refused


def _workers(client: Any) -> list[str]:
    return list(client.scheduler_info(n_workers=-1)['workers'])
