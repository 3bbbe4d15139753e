# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A Dask cluster of processes on this machine: a scheduler and workers, as a user starts them."""

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
import os
from pathlib import Path
import signal
import subprocess
import sys

import distributed
from running import PATIENCE, wait_for


@dataclass
class Cluster:
    """The address of a scheduler, a client of it, and its process."""

    address: str
    client: distributed.Client
    scheduler: subprocess.Popen[bytes]

    def kill_busy_worker(self) -> None:
        """Kill a worker as soon as it has a job, without a chance to say so."""

        def busy() -> list[str]:
            return [address for address, jobs in self.client.processing().items() if jobs]

        (pid,) = self.client.run(os.getpid, workers=wait_for(busy, 'a job')[:1]).values()
        os.kill(pid, signal.SIGKILL)

    @property
    def workers(self) -> int:
        """Number of workers."""
        return len(self.client.scheduler_info(n_workers=-1)['workers'])


@contextmanager
def cluster(
    folder: Path, workers: int, environment: Mapping[str, str] | None = None, nannies: bool = False
) -> Iterator[Cluster]:
    """Have a cluster with so many workers, of one thread each, until the block ends.

    The first worker has further variables of `environment`. With `nannies` those that die are
    started again, as they are for a user by default.
    """
    file = folder / 'scheduler.json'
    with ExitStack() as stack:
        scheduler = _start(stack, folder, 'scheduler', '--scheduler-file', file, '--host',
                           '127.0.0.1', '--port', '0')  # fmt: skip
        wait_for(file.exists, 'the scheduler')
        for number in range(workers):
            own = dict(environment or {}) if number == 0 else {}
            _start(stack, folder, 'worker', '--scheduler-file', file, '--nthreads', '1',
                   '--nanny' if nannies else '--no-nanny', '--local-directory', folder,
                   environment=own)  # fmt: skip
        client = distributed.Client(scheduler_file=str(file), set_as_default=False)
        stack.callback(client.close, timeout=PATIENCE)
        client.wait_for_workers(workers, timeout=PATIENCE)
        yield Cluster(client.scheduler.address, client, scheduler)


def _start(
    stack: ExitStack, folder: Path, kind: str, *options: object,
    environment: Mapping[str, str] | None = None,
) -> subprocess.Popen[bytes]:  # fmt: skip
    command = [sys.executable, '-m', f'distributed.cli.dask_{kind}', '--no-dashboard']
    log = stack.enter_context((folder / f'{kind}.log').open('a'))
    process = subprocess.Popen(
        [*command, *map(str, options)], stdout=log, stderr=log, cwd=folder,
        env={**os.environ, **(environment or {})},
    )  # fmt: skip

    def end() -> None:
        process.terminate()
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    stack.callback(end)
    return process
