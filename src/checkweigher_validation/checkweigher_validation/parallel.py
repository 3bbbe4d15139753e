"""Independent pieces of work on all cores."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, as_completed
import os
from typing import Generic, Protocol, TypeVar

from checkweigher_dsp.pipeline.side_processes import SideProcesses

R_co = TypeVar('R_co', covariant=True)


class WorkerLostError(ValueError):
    """A process that died at its work."""


class Task(Protocol, Generic[R_co]):
    """A piece of work; it goes to another process, so it must be one that can be pickled."""

    def run(self) -> R_co:
        """Do it and return the result."""


def run_all(
    tasks: 'Sequence[Task[R_co]]',
    workers: int | None = None,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[R_co]:
    """Run tasks side by side.

    Parameters
    ----------
    tasks : sequence of Task
        The work.
    workers : int, optional
        Processes; by default one for each core.
    on_progress : callable
        Called with the number of tasks that are done and that of all.

    Returns
    -------
    list
        The results, in the order of the tasks.

    Raises
    ------
    WorkerLostError
        If a process was killed.
    """
    results: dict[int, R_co] = {}
    for number, result in _results(tasks, workers or len(os.sched_getaffinity(0))):
        results[number] = result
        on_progress(len(results), len(tasks))
    return [results[number] for number in range(len(tasks))]


def _results(tasks: 'Sequence[Task[R_co]]', workers: int) -> Iterator[tuple[int, R_co]]:
    """Yield number and result of each task as they come."""
    count = min(workers, len(tasks))
    if count <= 1:
        yield from ((number, task.run()) for number, task in enumerate(tasks))
        return
    with SideProcesses(count) as processes:
        try:
            futures = {processes.submit(task.run): number for number, task in enumerate(tasks)}
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenExecutor:
            raise WorkerLostError(
                'a worker process was killed, perhaps for lack of memory; try with --jobs 1'
            ) from None
