# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Levels of the outputs, and timing errors of their changes."""

import math
from typing import NamedTuple


class Levels(NamedTuple):
    """Levels of the outputs: rejector, stop, permit to pass the rejector, and each station.

    A level is true while the rejector or the station acts, while the line has to stop, or while a
    permit is given.
    """

    reject: bool
    stop: bool
    permit: bool = False
    stations: tuple[bool, ...] = ()


class Switches(NamedTuple):
    """Times of the next changes of rejector, permit and any station.

    The times are in ns on the monotonic clock, and infinite for an output without a scheduled
    change.
    """

    reject: float = math.inf
    permit: float = math.inf
    station: float = math.inf


class SwitchTiming:
    """Timing errors of the outputs. A change is late if its error exceeds `late_tolerance` in ns.

    `figures` contains the number of switches of the rejector, their mean and largest error in ms,
    positive if late, and their largest uncertainty in ms.
    """

    def __init__(self, late_tolerance: int) -> None:
        self._late_tolerance = late_tolerance
        self.figures: dict[str, float] = {
            'switches': 0,
            'switch error ms': 0,
            'largest switch error ms': 0,
            'switch uncertainty ms': 0,
        }

    def add(self, before: Levels, after: Levels, due: Switches, begun: int, done: int) -> list[str]:
        """Add a change of the outputs between times `begun` and `done`; return messages on delays.

        `before` and `after` are the levels before and after the change, and `due` contains the
        times at which the outputs had to change. A message is returned only if the start of a pulse
        or the end of a permit was late.
        """
        rejector = before.reject != after.reject and due.reject <= begun
        if rejector:
            self._count(1e-6 * ((begun + done) / 2 - due.reject), 1e-6 * (done - begun) / 2)
        stations = zip(before.stations, after.stations, strict=True)
        station = due.station <= begun and any(new and not old for old, new in stations)
        delays = (
            ('the rejector was', rejector and after.reject, done - due.reject),
            ('a station was', station, done - due.station),
            ('the end of a permit was', before.permit and not after.permit, done - due.permit),
        )
        return [
            f'{what} {1e-6 * late:.0f} ms late; look behind it'
            for what, matters, late in delays
            if matters and late > self._late_tolerance
        ]

    def _count(self, error: float, uncertainty: float) -> None:
        """Add a change of the rejector with its error and uncertainty in ms."""
        figures = self.figures
        figures['switches'] += 1
        figures['switch error ms'] += (error - figures['switch error ms']) / figures['switches']
        largest = 'largest switch error ms'
        figures[largest] = max(figures[largest], error, key=abs)
        figures['switch uncertainty ms'] = max(figures['switch uncertainty ms'], uncertainty)
