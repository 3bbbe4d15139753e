# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Health of a source: its samples, clock and photo-eyes."""

from collections.abc import Mapping

from checkweigher_core.health.findings import Finding, conclude, error_if, warn_if
from checkweigher_core.health.stream import EyeWatch, SampleWatch
from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, LoadCell, SampleBlock


class DriverWatch:
    """Monitor of the source `name` and of its stream.

    Times are in s on a monotonic clock. Callers must hold the lock of the process. The caller sets
    `waits_for` to the condition that the source waits for. The next event resets `waits_for` to an
    empty string.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._began = 0.0
        self._samples: SampleWatch | None = None
        self._eyes = EyeWatch()
        self._change('inactive')

    def begin(self, load_cell: LoadCell, now: float) -> None:
        """Begin to monitor a new stream of `load_cell` at time `now`."""
        self._began = now
        self._samples = SampleWatch(load_cell)
        self._eyes = EyeWatch()
        self._change('running')

    def stop(self) -> None:
        """Record that the driver was deactivated, which has ended the stream."""
        self._samples = None
        self._change('inactive')

    def add(self, now: float, event: Event) -> None:
        """Add an event that is sent at time `now`."""
        assert self._samples is not None
        self.waits_for = ''
        if isinstance(event, SampleBlock):
            self._samples.add(now, event)
        elif isinstance(event, EyeEdge):
            self._samples.clock.add_edge(now, event)
            self._eyes.add(now, event)

    def end(self, failure: str | None = None) -> None:
        """Record the end of the source.

        `failure` is the message of the error that ended the source, or None without an error.
        """
        self._change('finished' if failure is None else 'failed', failure or '')

    def _change(self, state: str, failure: str = '') -> None:
        self._state, self._failure, self.waits_for = state, failure, ''

    def findings(
        self, now: float, offset_of_clocks: float, trouble: str, figures: Mapping[str, float]
    ) -> list[Finding]:
        """Return the findings on source, samples, clock and photo-eyes at time `now`.

        While the driver is inactive, only the finding on the source is returned. `offset_of_clocks`
        is the Unix time minus `now` in s. `trouble` is the present fault of the source, or ''.
        `figures` contains values of the source for the diagnostics, by name.
        """
        source = self._source(trouble, figures)
        if self._samples is None:
            return [source]
        self._samples.look(now)
        self._eyes.look(now)
        samples = self._samples.finding(now, now - self._began)
        eyes = self._eyes.finding(now)
        # A source that has ended or that waits sends no samples.
        if self._state != 'running' or self.waits_for:
            samples, eyes = (
                conclude(finding.aspect, 'none at present, see Source', (), finding.values)
                for finding in (samples, eyes)
            )
        return [source, samples, self._samples.clock.finding(offset_of_clocks), eyes]

    def _source(self, trouble: str, figures: Mapping[str, float]) -> Finding:
        concerns = (
            error_if(
                self._state == 'failed',
                f'{self._name} failed: {self._failure}',
                'check its cable, power and parameters, then restart the driver',
            ),
            error_if(
                bool(trouble), trouble, 'check cable and power; after the repair, reset the stop'
            ),
            warn_if(
                self._state == 'inactive',
                'the driver is inactive',
                'activate it with Start on the page, or with ros2 lifecycle set',
            ),
            warn_if(
                bool(self.waits_for),
                f'{self._name} is held back, waiting for {self.waits_for}',
                'check that the other nodes are running',
            ),
        )
        values: dict[str, float | str] = {
            'source': self._name,
            'state': self._state,
            'error': self._failure or trouble,
            **{name.replace(' ', '_'): value for name, value in figures.items()},
        }
        return conclude('Source', f'{self._name}, {self._state}', concerns, values)
