"""Processes beside this one, so that offline work has all cores."""

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from importlib import import_module
import multiprocessing
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
import os
import pickle
import queue
import signal
import sys
import threading
import traceback
from types import TracebackType
from typing import Any, Self, TypeVar

R = TypeVar('R')

# What a matrix library takes for the number of its own threads: with a process for each core
# already at work, more of them only stand in each other's way.
_THREADS = ('OPENBLAS_NUM_THREADS', 'OMP_NUM_THREADS', 'MKL_NUM_THREADS')
_THREADED = {'numpy', 'rclpy'}  # have or begin threads that Python does not know of
_INTERRUPT = {signal.SIGINT}
_MOST = 3  # beside this one: what cannot be shared out is soon all that is left
# What goes to another process passes a thread that has to wait so long for its turn.
_SWITCH_INTERVAL = 0.0005  # s


class SideProcesses:
    """Processes that take calls until the end of a ``with`` block.

    Each has a pipe of its own: one that is killed, at whatever it is, leaves nobody waiting. With
    concurrent.futures all have one queue for their results, which a process that is killed in the
    middle of one leaves locked (so the documentation of multiprocessing warns): with Ctrl-C the
    command waited for ever then.

    Parameters
    ----------
    count : int
        Processes; 0 for none, and nothing may be submitted then.
    modules : iterable of str
        What each of them imports at once, while this process goes on.
    ahead : int
        Calls that one has before it. With 2 it does not wait for the next one, but may have two
        while another one has none: for many short ones.

    Attributes
    ----------
    count : int
        Processes.
    """

    def __init__(self, count: int, modules: Iterable[str] = (), ahead: int = 1) -> None:
        self.count = count
        self._ahead = ahead
        self._modules = tuple(modules)
        self._calls = _Calls()
        self._workers: list[_Worker] = []
        self._kept: dict[str, str | None] = {}
        self._switch_interval = sys.getswitchinterval()

    def __enter__(self) -> Self:
        """Start the processes."""
        self._kept = {name: os.environ.get(name) for name in _THREADS}
        self._switch_interval = sys.getswitchinterval()
        if self.count:
            os.environ.update(dict.fromkeys(_THREADS, '1'))
            sys.setswitchinterval(min(self._switch_interval, _SWITCH_INTERVAL))
            self._start()
            self.load(*self._modules)
        return self

    def _start(self) -> None:
        # A fresh process takes longer, but the fork of one with threads may hang.
        forks = threading.active_count() == 1 and not _THREADED & sys.modules.keys()
        context = multiprocessing.get_context('fork' if forks else 'spawn')
        if not forks:
            resource_tracker.ensure_running()
        # A process that has only just begun would report Ctrl-C with a traceback.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _INTERRUPT)
        try:
            for _ in range(self.count):
                self._workers.append(_Worker(context, self._calls, self._ahead))
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for worker in self._workers:
            worker.begin()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        """End the processes, of which nobody has to wait for one that has done its work."""
        self._calls.give_up()
        for worker in self._workers if error is not None else ():
            worker.kill()
        sys.setswitchinterval(self._switch_interval)
        for name, value in self._kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value

    def load(self, *modules: str) -> None:
        """Have modules imported in the processes, after what they have to do already."""
        for _ in range(self.count if modules else 0):
            self.submit(_load, modules)

    def submit(self, call: Callable[..., R], *arguments: Any) -> Future[R]:
        """Have a function of a module called; all that goes there and back is pickled.

        Whatever goes wrong the result says: BrokenExecutor if a process was killed.
        """
        assert self.count
        return self._calls.put(call, arguments)

    def submit_by_name(
        self, module: str, name: str, *arguments: Any, **keywords: Any
    ) -> Future[Any]:
        """Have a function called whose module is imported there, but need not be here."""
        return self.submit(_call, module, name, arguments, keywords)


def spare_cores() -> int:
    """Return how many processes a long piece of work should have beside this one."""
    return min(len(os.sched_getaffinity(0)) - 1, _MOST)


_Submitted = tuple[Future[Any], Callable[..., Any], tuple[Any, ...]]


class _Calls:
    """Calls that no process has yet, for whichever takes them."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[_Submitted | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._is_over = False

    def put(self, call: Callable[..., R], arguments: tuple[Any, ...]) -> Future[R]:
        future: Future[R] = Future()
        with self._lock:
            if self._is_over:
                future.set_exception(_lost())
            else:
                self._queue.put((future, call, arguments))
        return future

    def take(self) -> tuple[Future[Any], bytes] | None:
        """Wait for a call and return it, pickled; None if no more will come."""
        while submitted := self._queue.get():
            future, *call = submitted
            try:
                if future.set_running_or_notify_cancel():
                    return future, pickle.dumps(call, pickle.HIGHEST_PROTOCOL)
            except Exception as error:
                future.set_exception(error)
        self.give_up()  # nor will the other processes get any
        return None

    def give_up(self) -> None:
        """Have no call done any more that nobody has taken."""
        with self._lock:
            self._is_over = True
            while not self._queue.empty():
                submitted = self._queue.get()
                if submitted is not None:
                    submitted[0].set_exception(_lost())
            self._queue.put(None)


class _Worker:
    """A process, and the two threads that hand calls to it and take the results."""

    def __init__(self, context: Any, calls: _Calls, ahead: int) -> None:
        self._calls = calls
        self._room = threading.Semaphore(ahead)
        self._given: deque[Future[Any]] = deque()
        self._pipe, there = context.Pipe()
        self._process = context.Process(target=_serve, args=(there,), daemon=True)
        self._process.start()
        there.close()  # so that its end is the end of the pipe

    def begin(self) -> None:
        # Not before all processes have been forked.
        for work in (self._hand_over, self._take_results):
            threading.Thread(target=work, daemon=True).start()

    def kill(self) -> None:
        self._process.kill()
        self._process.join()

    def _hand_over(self) -> None:
        with suppress(OSError):  # it has ended
            while self._room.acquire() and (taken := self._calls.take()):
                future, data = taken
                self._given.append(future)
                self._pipe.send_bytes(data)
            self._pipe.send_bytes(b'')
            return
        self._lose()

    def _take_results(self) -> None:
        with suppress(EOFError, OSError):  # it has ended
            while True:
                data = self._pipe.recv_bytes()
                future = self._given.popleft()
                self._room.release()
                try:
                    is_result, value = pickle.loads(data)
                except Exception as error:
                    is_result, value = False, error
                if is_result:
                    future.set_result(value)
                else:
                    future.set_exception(value)
        self._calls.give_up()
        self._room.release()
        self._lose()

    def _lose(self) -> None:
        with suppress(IndexError):  # the two threads may meet here
            while True:
                self._given.popleft().set_exception(_lost())


def _lost() -> BrokenExecutor:
    return BrokenExecutor('a process beside this one has ended')


def _serve(pipe: Connection) -> None:
    """Do calls, in another process, until an empty one comes."""
    # End without a word by Ctrl-C, which goes to all processes, and with the parent.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _INTERRUPT)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):  # the parent has ended
        while data := pipe.recv_bytes():
            pipe.send_bytes(_done(data))


def _done(data: bytes) -> bytes:
    """Return what a call returns, or else what it raises."""
    try:
        call, arguments = pickle.loads(data)
        return pickle.dumps((True, call(*arguments)), pickle.HIGHEST_PROTOCOL)
    except Exception as error:
        error.add_note(traceback.format_exc())
        try:
            return pickle.dumps((False, error))
        except Exception:
            return pickle.dumps((False, RuntimeError(traceback.format_exc())))


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _load(modules: Iterable[str]) -> None:
    for name in modules:
        import_module(name)


def _call(module: str, name: str, arguments: Iterable[Any], keywords: dict[str, Any]) -> Any:
    return getattr(import_module(module), name)(*arguments, **keywords)


ALONE = SideProcesses(0)
