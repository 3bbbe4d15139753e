"""Which executor calls the callbacks of a process: that of rclpy, or one that is faster."""

from dataclasses import dataclass
import os
from typing import Any, ClassVar

from rclpy.executors import SingleThreadedExecutor, TimeoutObject
from rclpy.node import Node
from rclpy.task import Future

from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.ros.delivery import Delivery

CACHED = 'cached'
SINGLE_THREADED = 'single_threaded'
INTRA_PROCESS = 'intra_process'
TRANSPORTS = (INTRA_PROCESS, 'dds')
EXECUTORS = (SINGLE_THREADED, CACHED)
# Which one the commands have, and the nodes where no parameter says so.
DEFAULT_TRANSPORT = os.environ.get('CHECKWEIGHER_TRANSPORT', INTRA_PROCESS)
DEFAULT = os.environ.get('CHECKWEIGHER_EXECUTOR', CACHED)


@dataclass(frozen=True)
class ProcessParameters(Parameters):
    """What all nodes of a process share."""

    node: ClassVar[str] = 'executor'

    executor: str = parameter(
        DEFAULT, 'what calls the callbacks; cached, which is faster, where all nodes of a process '
        'say so', choices=EXECUTORS,
    )  # fmt: skip
    transport: str = parameter(
        DEFAULT_TRANSPORT, 'how messages reach the nodes of the same process: handed over as they '
        'are, or over DDS as to all others', choices=TRANSPORTS,
    )  # fmt: skip


class DeliveringExecutor(SingleThreadedExecutor):
    """That of rclpy, whose callbacks take turns with messages that are handed over.

    Parameters
    ----------
    delivery : Delivery
        Hands them over.
    """

    def __init__(self, delivery: Delivery, **options: Any) -> None:
        self._delivery = delivery
        super().__init__(**options)
        delivery.attach(self)

    def add_node(self, node: Node) -> bool:
        """Serve one more node."""
        added = bool(super().add_node(node))
        if added:
            self._delivery.open(node)
        return added

    def remove_node(self, node: Node) -> None:
        """Serve a node no longer."""
        self._delivery.close(node)
        super().remove_node(node)

    def nudge(self) -> None:
        """Have a wait end, from any thread."""
        self.wake()

    def shutdown(self, timeout_sec: float | None = None) -> bool:
        """Stop for good."""
        self._delivery.attach(None)
        return bool(super().shutdown(timeout_sec))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        """Do what is ready, or wait for it."""
        with self._delivery.turn():
            super().spin_once(timeout_sec)

    def spin_once_until_future_complete(
        self, future: Future, timeout_sec: float | TimeoutObject | None = None
    ) -> None:
        """Do what is ready, or wait for it or for a future."""
        with self._delivery.turn():
            super().spin_once_until_future_complete(future, timeout_sec)

    def wait_for_ready_callbacks(self, *args: Any, **kwargs: Any) -> Any:
        """Return a callback that is ready; nothing is called meanwhile by this thread."""
        with self._delivery.away():
            return super().wait_for_ready_callbacks(*args, **kwargs)


def make_executor(*names: str, delivery: Delivery | None = None) -> DeliveringExecutor:
    """Return an executor.

    Parameters
    ----------
    names : str
        What the nodes of the process say, each one of `EXECUTORS`; none for the default.
    delivery : Delivery, optional
        What hands messages over between the nodes.

    Raises
    ------
    ParameterError
        If there is no such executor.
    """
    wanted = names or (DEFAULT,)
    for name in wanted:
        if name not in EXECUTORS:
            raise ParameterError(f'executor: {name!r} is not one of {", ".join(EXECUTORS)}')
    delivery = delivery or Delivery()
    if SINGLE_THREADED in wanted:
        return DeliveringExecutor(delivery)
    try:
        from checkweigher_dsp.ros.cached_executor import CachedExecutor

        return CachedExecutor(delivery)
    except (ImportError, AttributeError):
        # It reads what rclpy keeps to itself: another rclpy may not have it, and does without.
        return DeliveringExecutor(delivery)
