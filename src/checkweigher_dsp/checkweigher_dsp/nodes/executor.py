"""Which executor calls the callbacks of a process: that of rclpy, or one that is faster."""

from dataclasses import dataclass
import os
from typing import ClassVar

from rclpy.executors import SingleThreadedExecutor

from checkweigher_dsp.parameters import ParameterError, Parameters, parameter

CACHED = 'cached'
SINGLE_THREADED = 'single_threaded'
EXECUTORS = (SINGLE_THREADED, CACHED)
# Which one the commands have, and the nodes where no parameter says so.
DEFAULT = os.environ.get('CHECKWEIGHER_EXECUTOR', SINGLE_THREADED)


@dataclass(frozen=True)
class ProcessParameters(Parameters):
    """What all nodes of a process share."""

    node: ClassVar[str] = 'executor'

    executor: str = parameter(
        DEFAULT, 'what calls the callbacks; cached is faster, and has to be said by all nodes of a '
        'process', choices=EXECUTORS,
    )  # fmt: skip


def make_executor(*names: str) -> SingleThreadedExecutor:
    """Return an executor.

    Parameters
    ----------
    names : str
        What the nodes of the process say, each one of `EXECUTORS`; none for the default.

    Raises
    ------
    ParameterError
        If there is no such executor.
    """
    wanted = names or (DEFAULT,)
    for name in wanted:
        if name not in EXECUTORS:
            raise ParameterError(f'executor: {name!r} is not one of {", ".join(EXECUTORS)}')
    if SINGLE_THREADED in wanted:
        return SingleThreadedExecutor()
    # It reads what rclpy keeps to itself: another rclpy may not have it, and does without.
    from checkweigher_dsp.nodes.cached_executor import CachedExecutor

    return CachedExecutor()
