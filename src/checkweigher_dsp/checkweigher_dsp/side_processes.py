"""Processes beside this one, so that offline work has all cores."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
import multiprocessing
from multiprocessing import resource_tracker
import os
import signal
import sys
import threading
from types import TracebackType
from typing import Any, Self, TypeVar

R = TypeVar('R')

# What a matrix library takes for the number of its own threads: with a process for each core
# already at work, more of them only stand in each other's way.
_THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
_INTERRUPT = {signal.SIGINT}
_MOST = 3  # beside this one: what cannot be shared out is soon all that is left
# What goes to another process passes two threads, and each of them waits so long for its turn.
_SWITCH_INTERVAL = 0.0005  # s


class SideProcesses:
    """Processes that take calls until the end of a ``with`` block.

    Parameters
    ----------
    count : int
        Processes; 0 for none, and nothing may be submitted then.
    modules : iterable of str
        What each of them imports at once, while this process goes on.

    Attributes
    ----------
    count : int
        Processes.
    """

    def __init__(self, count: int, modules: Iterable[str] = ()) -> None:
        self.count = count
        self._modules = tuple(modules)
        self._pool: ProcessPoolExecutor | None = None
        self._kept: dict[str, str | None] = {}
        self._switch_interval = sys.getswitchinterval()

    def __enter__(self) -> Self:
        """Start the processes."""
        self._kept = {name: os.environ.get(name) for name in _THREADS}
        if self.count:
            os.environ.update(dict.fromkeys(_THREADS, '1'))
            self._switch_interval = sys.getswitchinterval()
            sys.setswitchinterval(min(self._switch_interval, _SWITCH_INTERVAL))
            # Fresh processes: the fork of one with threads may hang.
            context = multiprocessing.get_context('spawn')
            self._pool = ProcessPoolExecutor(self.count, context, _begin)
            if self._modules:
                self.load(*self._modules)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        """End the processes, of which nobody has to wait for one that has done its work."""
        if self._pool is not None:
            self._pool.shutdown(wait=error is not None, cancel_futures=True)
            sys.setswitchinterval(self._switch_interval)
        for name, value in self._kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

    def load(self, *modules: str) -> None:
        """Have each process import modules, after what it has been given to do before."""
        # Each call is one for a process that is yet to be started.
        for _ in range(self.count):
            self.submit(_load, modules)

    def submit(self, call: Callable[..., R], *arguments: Any) -> Future[R]:
        """Have a function of a module called; all that goes there and back is pickled.

        Whatever goes wrong the result says: BrokenProcessPool if a process was killed.
        """
        assert self._pool is not None
        # A process that has only just begun would report Ctrl-C with a traceback.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPT)
        try:
            return self._pool.submit(call, *arguments)
        except BrokenProcessPool as error:
            lost: Future[R] = Future()
            lost.set_exception(error)
            return lost
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def submit_by_name(
        self, module: str, name: str, *arguments: Any, **keywords: Any
    ) -> Future[Any]:
        """Have a function called whose module is imported there, but need not be here."""
        return self.submit(_call, module, name, arguments, keywords)


ALONE = SideProcesses(0)


def spare_cores() -> int:
    """Return how many processes a long piece of work should have beside this one."""
    return min(len(os.sched_getaffinity(0)) - 1, _MOST)


def _begin() -> None:
    """End without a word by Ctrl-C, which goes to all processes, and with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPT)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _load(modules: Iterable[str]) -> None:
    for name in modules:
        import_module(name)


def _call(module: str, name: str, arguments: Sequence[Any], keywords: Mapping[str, Any]) -> Any:
    return getattr(import_module(module), name)(*arguments, **keywords)
