# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that receive the results of lanes, and the signals of lanes that have viewers."""

from collections.abc import Callable
import threading
import time
from typing import Any

from checkweigher_core.ros import ports
from checkweigher_core.ros.graph.lanes import running_lanes
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner
from checkweigher_core.ros.status_board import StatusBoard, number_of
from checkweigher_web.lane import SHOWN, BeltNoise, Lane

# Name of the diagnostic status of the belt noise, without the namespace of the lane.
_NOISE = 'segmenter: Belt noise'
_LOOK_PERIOD = 0.5  # s


class _Listener(PortNode):
    def __init__(self, name: str, lane: Lane, listened: tuple[ports.Port, ...]) -> None:
        super().__init__(name, namespace=f'/{lane.name}')
        for port in listened:
            self.subscribe(port, lane.take, qos=port.qos)


class Watch:
    """Running lanes, which are found by their verdict topics unless `namespace` is given.

    A thread looks for lanes, and subscribes to the signals of a lane while `viewers` returns a
    number above 0 for that lane. The thread is needed, because an executor cannot change its own
    nodes while it runs them. Each lane holds the samples of the last `held` s.

    Attributes
    ----------
    lanes : dict of str to Lane
        Lanes by namespace, which may be ''. Lanes that have ended are included.
    board : StatusBoard
        Diagnostics of the watched lanes.
    only : str or None
        Namespace of the only lane that is watched, or None if all lanes are watched.
    """

    def __init__(self, spinner: Spinner, namespace: str | None = None, held: float = SHOWN) -> None:
        self.lanes: dict[str, Lane] = {}
        self.board = StatusBoard(namespace or '')
        self.viewers: Callable[[str], int] = lambda lane: 0
        self._spinner = spinner
        self.only = namespace
        self._held = held
        self._signals: dict[str, PortNode] = {}
        self._finder = PortNode('page')
        self._finder.subscribe(ports.DIAGNOSTICS, self._diagnose)
        spinner.add(self._finder)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, name='lanes', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread that looks for lanes."""
        self._ended.set()
        self._thread.join()

    def _diagnose(self, message: Any) -> None:
        self.board.add(time.monotonic(), message.status)
        for status in message.status:
            lane, found, _ = status.name.partition(_NOISE)
            if found and (name := lane.strip('/')) in self.lanes:
                values = {each.key: each.value for each in status.values}
                grams = number_of(values.get('std_dev_g', ''))
                self.lanes[name].take(BeltNoise(time.time_ns(), grams))

    def _look(self) -> None:
        while not self._ended.wait(_LOOK_PERIOD):
            for name in self._names() - self.lanes.keys():
                self.board.expect(time.monotonic(), name)
                lane = Lane(name, self._held)
                self._spinner.add(_Listener('page_results', lane, ports.PAGE_RESULTS))
                self.lanes[name] = lane
            for name, lane in self.lanes.items():
                watched = self.viewers(name) > 0
                if watched and name not in self._signals:
                    self._signals[name] = _Listener('page_signals', lane, ports.PAGE_SIGNALS)
                    self._spinner.add(self._signals[name])
                elif not watched and name in self._signals:
                    self._spinner.remove(self._signals.pop(name))
                    lane.forget_signals()

    def _names(self) -> set[str]:
        if self.only is not None:
            return {self.only}
        return running_lanes(self._finder)
