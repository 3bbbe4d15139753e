# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Execution of nodes in a process until a signal ends the process."""

from collections.abc import Callable, Sequence
import contextlib
import ctypes
import faulthandler
import inspect
import signal
import sys
import threading
from types import FrameType
from typing import cast

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from checkweigher_core.parameters import ParameterError
from checkweigher_core.parent_process import CANNOT_START, end_with_parent
from checkweigher_core.printable import one_line
from checkweigher_core.ros.spinner import Spinner
from checkweigher_core.ros.stage_node import StageNode

# Number of the option M_MMAP_THRESHOLD of glibc, and its value: the size in bytes above which glibc
# returns a freed block of memory to the system. By default, this size grows with the largest freed
# block, so a process would keep the memory of a large message.
_MMAP_THRESHOLD, _LARGE = -3, 2**17
# Longest wait until all subscribers have acknowledged the last messages of an output.
_FAREWELL = Duration(seconds=1)
# Time in s after which a process that hangs while it destroys its nodes is ended. The node
# `verifier` may need 20 s to complete its report.
DESTRUCTION = 30.0


def run(make_node: Callable[[], Node], arguments: Sequence[str] | None = None) -> None:
    """Run one node until SIGINT, SIGTERM or SIGHUP. Exit with status 2 if the node cannot start."""
    run_all(lambda: [make_node()], arguments)


def run_all(
    make_nodes: Callable[[], Sequence[Node]], arguments: Sequence[str] | None = None
) -> None:
    """Run several nodes in one process until SIGINT, SIGTERM or SIGHUP.

    The nodes start in the order in which `make_nodes` returns them, and shut down in reverse order.
    While the nodes are made, a signal raises KeyboardInterrupt, which ends the process. After the
    nodes were made, a signal only wakes the main thread, which then shuts down the nodes, because
    KeyboardInterrupt would interrupt a callback. The signal handlers of rclpy are not used, because
    they would destroy the context during a callback. The exit status of the process is 2 if a node
    cannot start, and 1 if the executor fails.
    """
    stopping = threading.Event()
    starting = True

    def stop(*_: object) -> None:
        stopping.set()
        if starting:
            raise KeyboardInterrupt

    _on_signals(stop)
    nodes: Sequence[Node] = ()
    spinner: Spinner | None = None
    try:
        end_with_parent()
        with contextlib.suppress(AttributeError):  # only glibc has mallopt
            ctypes.CDLL(None).mallopt(_MMAP_THRESHOLD, _LARGE)
        _initialise(arguments)
        nodes = make_nodes()
        # Call getframeinfo before the nodes run. rclpy calls getframeinfo for each log message, and
        # the first call takes 0.1 s or more, which would delay the first message.
        inspect.getframeinfo(cast(FrameType, inspect.currentframe()))
        starting = False
        spinner = Spinner(stopping.set)
        spinner.add(*nodes)
        stopping.wait()
    except ParameterError as error:
        print(f'checkweigher: {one_line(error)}', file=sys.stderr)
        raise SystemExit(CANNOT_START) from None
    except (Exception, KeyboardInterrupt):
        # After a signal, ignore any exception, because C++ code may have converted the
        # KeyboardInterrupt to another exception.
        if not stopping.is_set():
            raise
    finally:
        # With ros2 launch, Ctrl-C sends SIGINT twice. The second signal must not interrupt the
        # shutdown.
        starting = False
        if spinner is not None:
            _shut_down(nodes, spinner)
            # Limit the time for the destruction of the nodes. Fast DDS can block forever if a node
            # is destroyed while the nodes of another process end, see
            # https://github.com/eProsima/Fast-DDS/issues/6502.
            faulthandler.dump_traceback_later(DESTRUCTION, exit=True)
            spinner.stop()
        else:
            for node in reversed(nodes):
                node.destroy_node()
        rclpy.try_shutdown()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    if spinner is not None and spinner.error is not None:
        raise SystemExit(1)  # the executor thread has already printed the traceback


def _on_signals(stop: Callable[..., None]) -> None:
    signal.signal(signal.SIGINT, stop)
    signal.signal(signal.SIGTERM, stop)
    if signal.getsignal(signal.SIGHUP) != signal.SIG_IGN:  # ignored under nohup
        signal.signal(signal.SIGHUP, stop)


def _shut_down(nodes: Sequence[Node], spinner: Spinner) -> None:
    """Shut down the nodes in reverse order.

    While a node shuts down, the nodes before it in `nodes` still work. An exception of a node is
    printed, and the remaining nodes are shut down.
    """
    for node in reversed(nodes):
        if not isinstance(node, StageNode):
            continue
        try:
            if spinner.alive:
                spinner.call(node.shut_down)
            else:
                node.shut_down()
            for output in node.final_outputs():
                output.publisher.wait_for_all_acked(_FAREWELL)
        except Exception as error:  # continue, because the other nodes must be shut down
            print(f'checkweigher: {type(error).__name__}: {one_line(error)}', file=sys.stderr)


def _initialise(arguments: Sequence[str] | None) -> None:
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # The parameter file or the namespace is invalid. Remove the end of the message, which
        # contains positions in the source code of rcl.
        raise ParameterError(str(error).split(', at /')[0]) from None
