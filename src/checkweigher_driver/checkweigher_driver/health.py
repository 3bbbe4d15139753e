# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Health of a source: its state, samples, clock and photo-eyes."""

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.health.stream import EyeWatch, SampleWatch
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, LoadCell, SampleBlock


class DriverWatch:
    """State of a source and of its stream, for the diagnostics.

    Times are in s on a clock that never steps back. All but `findings` may be called from the
    thread that reads the source, whose name is `name`.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._began = 0.0
        self._samples: SampleWatch | None = None
        self._eyes = EyeWatch()
        self._state = 'inactive'
        self._failure = ''
        self._waits_for = ''
        self._trouble = ''
        self._figures: dict[str, float | str] = {}

    def begin(self, load_cell: LoadCell, now: float) -> None:
        """Follow a new stream of `load_cell`, which begins at `now`."""
        self._began = now
        self._samples = SampleWatch(load_cell)
        self._eyes = EyeWatch()
        self._state, self._failure, self._waits_for = 'running', '', ''

    def stop(self) -> None:
        """Note that the driver is inactive."""
        self._samples = None
        self._state, self._failure, self._waits_for = 'inactive', '', ''
        self._trouble = ''

    def add(self, now: float, event: Event) -> None:
        """Take an event that is sent."""
        self._waits_for = ''
        if self._samples is None:
            return
        if isinstance(event, SampleBlock):
            self._samples.add(now, event)
        elif isinstance(event, EyeEdge):
            self._samples.clock.add_edge(now, event)
            self._eyes.add(now, event)

    def waits_for(self, what: str) -> None:
        """Note that the source has long been held back, and for what."""
        self._waits_for = what

    def look(self, trouble: str, figures: dict[str, float]) -> None:
        """Take trouble and figures of the source itself."""
        self._trouble = trouble
        self._figures = {name.replace(' ', '_'): value for name, value in figures.items()}

    def end(self, failure: str | None = None) -> None:
        """Note that the source has ended, with a failure or without."""
        self._state = 'finished' if failure is None else 'failed'
        self._failure = failure or ''
        self._waits_for = ''

    def findings(self, now: float, offset_of_clocks: float) -> list[Finding]:
        """Return all aspects; `offset_of_clocks` is the time of day less `now`, s."""
        if self._samples is None:
            return [self._source()]
        self._samples.look(now)
        self._eyes.look(now)
        samples = self._samples.finding(now, now - self._began)
        eyes = self._eyes.finding(now)
        if self._state != 'running' or self._waits_for:  # then nothing has to come
            text = 'none now, see Source'
            samples, eyes = (
                conclude(finding.aspect, text, (), finding.values) for finding in (samples, eyes)
            )
        return [self._source(), samples, self._samples.clock.finding(offset_of_clocks), eyes]

    def _source(self) -> Finding:
        found = []
        if self._state == 'failed':
            text = f'{self._name} failed: {self._failure}'
            hint = 'check its cable, power and parameters, then start the driver again'
            found.append(Concern(Level.ERROR, text, hint))
        elif self._state == 'inactive':
            hint = 'activate it: Start on the page, or ros2 lifecycle set'
            found.append(Concern(Level.WARN, 'the driver is inactive', hint))
        elif self._trouble:
            hint = 'check cable and power; when it is over, call reset_stop_request'
            found.append(Concern(Level.ERROR, self._trouble, hint))
        elif self._waits_for:
            text = f'{self._name} is held back, waiting for {self._waits_for}'
            found.append(Concern(Level.WARN, text, 'check that the other nodes run'))
        values = {
            'source': self._name,
            'state': self._state,
            'error': self._failure or self._trouble,
            **self._figures,
        }
        return conclude('Source', f'{self._name}, {self._state}', found, values)
