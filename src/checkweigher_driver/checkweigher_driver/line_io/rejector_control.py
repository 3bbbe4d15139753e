# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Control of the rejector: levels of all outputs as a function of time."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS, Decision, EyeEdge, Item, Verdict
from checkweigher_driver.line_io.belt_record import OnBelt
from checkweigher_driver.line_io.rejector.arrivals import Arrivals
from checkweigher_driver.line_io.rejector.belt_items import BeltItems
from checkweigher_driver.line_io.rejector.belt_motion import BeltMotion
from checkweigher_driver.line_io.rejector.missed_products import MissedProducts
from checkweigher_driver.line_io.rejector.reject_pulses import PulseTimes
from checkweigher_driver.line_io.rejector.run_permission import RunPermission
from checkweigher_driver.line_io.rejector.sorter import Sorter
from checkweigher_driver.line_io.rejector.switching import Levels, Switches, SwitchTiming
from checkweigher_driver.line_io.rejector.verdict_watch import VerdictWatch

_duration = partial(parameter, unit='s', minimum=0, maximum=60)


@dataclass(frozen=True)
class OutputParameters(Parameters):
    """Parameters of the rejector, the permits and the stop output."""

    node: ClassVar[str] = 'rejector'

    pulse: float = _duration(0.1, 'duration of the pulse that rejects a product', minimum=0.001)
    min_pause: float = _duration(
        0.02, 'shortest pause between two pulses or permits; closer pulses are joined'
    )
    late_tolerance: float = _duration(
        0.01, 'largest delay of a pulse; after a longer delay the line stops'
    )
    belt_margin: float = _duration(
        0.05, 'extension at both ends of a pulse that a stop of the belt has delayed'
    )
    verdict_timeout: float = _duration(
        0.0,
        'longest time from a product at the outfeed eye to the next verdict, after which the '
        'rejector ejects and the line stops; 0: the travel time of the previous product from that '
        'eye to the rejector',
    )
    safe_state: str = parameter(
        'eject', 'state of the rejector while the driver is inactive', choices=('eject', 'retract')
    )
    cycle: float = _duration(
        0.05,
        'period with which all outputs are written and the belt input is read',
        minimum=0.005,
        maximum=10,
    )
    permit_margin: float = _duration(
        0.02,
        'time by which a permit begins before its product arrives at the rejector, and ends after '
        'the product has passed',
        maximum=10,
    )
    watchdog_time: float = _duration(
        0.25,
        'time without a heartbeat after which the machine ejects and stops by itself, and a '
        'person has to look for the products on the belt',
        minimum=0.02,
    )
    record: str = parameter(
        '',
        'file that records the products on the belt for the next start; empty for a file in '
        '$XDG_STATE_HOME/checkweigher or ~/.local/state/checkweigher, named after the outputs',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_pause > 10 * self.pulse:
            raise ParameterError(
                f'rejector.min_pause: {self.min_pause:g} s is more than ten times rejector.pulse '
                f'{self.pulse:g} s'
            )


class RejectorControl:
    """Levels of the outputs as a function of time, and products that may have been missed.

    `now` is always a time in ns on the monotonic clock. `active` is false in the safe state.
    `connected` is false while the outputs cannot be switched. The line has to stop without a fresh
    permission of the node reject, while `held` is true, and after a missed product.

    The times of pulses and permits follow from the positions of the items. After a stop of the belt
    that no belt input has measured, the positions are unknown. If the positions are unknown, all
    permits are cancelled, and the line stops until a person has looked for the rejected items.
    `permits` is true if the machine has a permit output. `stations` is the number of sorting
    stations in addition to the rejector. In the safe state the stations are off, so that only the
    rejector removes items.
    """

    def __init__(
        self, parameters: OutputParameters, *, permits: bool = False, stations: int = 0
    ) -> None:
        def nanoseconds(seconds: float) -> int:
            return round(seconds * NANOSECONDS)

        self.safe_levels = Levels(
            reject=parameters.safe_state == 'eject', stop=True, stations=(False,) * stations
        )
        self.active = self.held = self.connected = False
        self._watchdog_time = parameters.watchdog_time
        self._late_tolerance = nanoseconds(parameters.late_tolerance)
        self.motion = BeltMotion(nanoseconds(parameters.watchdog_time))
        self._arrivals = Arrivals(self.motion)
        self._items = BeltItems()
        self._verdicts = VerdictWatch(nanoseconds(parameters.verdict_timeout))
        self.missed = MissedProducts()
        self.run_permission = RunPermission(self.missed)
        times = PulseTimes(
            duration=nanoseconds(parameters.pulse),
            min_pause=nanoseconds(parameters.min_pause),
            late_tolerance=self._late_tolerance,
            belt_margin=nanoseconds(parameters.belt_margin),
        )
        margin = nanoseconds(parameters.permit_margin) if permits else None
        self._sorter = Sorter(times, stations, margin, self.motion, self._arrivals, self.missed)
        self._switching = SwitchTiming(self._late_tolerance)
        self._rejects = self._losses = 0

    @property
    def figures(self) -> dict[str, float]:
        """Values for the diagnostics: counts, and the timing errors of the rejector in ms."""
        return {
            'rejects': self._rejects,
            **self._sorter.figures,
            'output losses': self._losses,
            **self._switching.figures,
            'clock steps': self._arrivals.clock.steps,
        }

    def make_safe(self) -> None:
        """Enter the safe state.

        Items on the belt are reported as missed, which stops the line until a person has looked for
        them.
        """
        if self._items:
            self._report_doubt('the outputs were made safe', self._items.names())
        self.active = False
        self.motion.clear()
        self._verdicts.clear()
        self._sorter.clear()
        self._items.clear()

    def levels(self, now: int) -> Levels:
        """Return the levels that the outputs must have at time `now`."""
        to_monotonic, permitted = self._arrivals.clock.look(), self.run_permission.permits(now)
        if not self.active:
            return self.safe_levels
        self._check_silence(now)  # called before `leave`, because the message names all items
        self._items.leave(self.motion.time.at(now))
        self._check_verdicts(now, to_monotonic)
        reject, *stations = self._sorter.acting(now)
        stop = self.missed.stop(now) or not permitted or self.held
        if self.motion.allow(not stop, now):
            self._report_stop()
        return Levels(reject, stop, self._sorter.permits.given(now), tuple(stations))

    def _report_stop(self) -> None:
        """Cancel the permits and report the rejected items, because their positions are unknown."""
        self._sorter.permits.clear()
        bad = [each for each in self._items if each.decision not in (None, Decision.ACCEPT)]
        if names := [str(each) for each in bad if not each.reported]:
            self._report_doubt('the belt was stopped', names)
        for each in bad:
            each.reported = True

    def _report_doubt(self, why: str, names: Sequence[str]) -> None:
        self._sorter.permits.clear()
        what = f'look for {", ".join(names)}' if names else 'look for all items on the belt'
        self.missed.add(f'{why} before all items had passed the rejector: {what}')

    def on_belt(self) -> OnBelt:
        """Return the present state of the belt, which is recorded for the next start."""
        return OnBelt(self.motion.released, self._items.names(), self.missed.texts)

    def alive(self, begun: int, done: int) -> None:
        """Record a heartbeat that was sent between times `begun` and `done`."""
        self._check_silence(done)
        self.motion.heartbeat(begun)

    def _check_silence(self, now: int) -> None:
        """Report all items if the machine has stopped the belt because it got no heartbeat."""
        if self.motion.is_silent(now):
            self._report_doubt(
                f'the machine received no heartbeat for {self._watchdog_time:g} s',
                self._items.names(),
            )

    def next_switches(self, now: int) -> Switches:
        """Return the times in ns at which the outputs switch next; infinite in the safe state."""
        return self._sorter.next_switches(now) if self.active else Switches()

    def _check_verdicts(self, now: int, to_monotonic: int | None) -> None:
        """Eject and stop if a verdict is overdue, or if an item at the rejector has no verdict."""
        if self._verdicts.is_overdue(now):
            within = f'{self._verdicts.timeout / NANOSECONDS:.2g} s'
            self._sorter.eject(
                now,
                f'a product left the belt and no verdict came within {within}; check that reject '
                'runs, and look behind the rejector',
            )
        for item in self._arrivals.unjudged(self._items, now, self._late_tolerance, to_monotonic):
            if not item.reported:
                item.reported = True
                self._sorter.eject(now, f'{item} must be at the rejector by now; look for it')

    def edge(self, edge: EyeEdge, now: int) -> None:
        """Update the items on the belt and the deadline of the next verdict after an edge."""
        self._verdicts.edge(edge, now)
        self._items.edge(edge)

    def announce(self, item: Item) -> None:
        """Set the number and the time t2 of an item on the belt from a message of the segmenter."""
        self._items.announce(item)

    def verdict(self, verdict: Verdict, now: int) -> None:
        """Schedule the pulse and the permit of an item according to its verdict.

        In the safe state nothing is scheduled, and a rejected item is reported as missed if the
        rejector is retracted.
        """
        self._verdicts.verdict(verdict)
        rejected = verdict.decision != Decision.ACCEPT
        self._rejects += rejected
        if self.active:
            self._sorter.sort(verdict, self._items, now, reached=self.connected)
        elif rejected and not self.safe_levels.reject:
            self.missed.add(f'item {verdict.item_id}: the rejector was not active; look for it')

    def connect(self, now: int) -> None:
        """Record a new connection, in which the outputs are in the safe state.

        If items were on the belt while the outputs could not be switched, or if a pulse has begun
        in this time, products are reported as missed.
        """
        self.connected = True
        if self.motion.released and self._items:
            self._report_doubt('the connection to the machine was lost', self._items.names())
        self._sorter.reconnect(now)

    def disconnect(self) -> None:
        """Record the loss of the connection. The state of the belt input is unknown afterwards."""
        self._losses += self.connected
        self.connected = False
        self.motion.measured = None

    def switched(self, before: Levels, after: Levels, due: Switches, begun: int, done: int) -> None:
        """Report missed products if outputs were switched too late, which stops the line.

        The outputs were switched from the levels `before` to the levels `after` between times
        `begun` and `done`. `due` contains the times at which they had to be switched.
        """
        for text in self._switching.add(before, after, due, begun, done):
            self.missed.add(text)

    def belt(self, running: bool | None, now: int) -> None:
        """Record the state of the belt input, and extend the pulses if the belt starts.

        `running` is None if there is no belt input.
        """
        here = self.motion.measure(running, now)
        if here is not None:
            self._sorter.resume(here)
