"""Rejector and stop as the driver node has them: of a machine that has outputs, or of none."""

from collections.abc import Callable
from typing import Any

from checkweigher_msgs.msg import StopRequest

from checkweigher_driver.line_io.outputs import MachineOutputs
from checkweigher_dsp.health.findings import Concern, Finding, Level, conclude
from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import EyeEdge, Verdict


class LineOutputs:
    """Hand on what the outputs have to know, and tell what the line has to know of them.

    What the rejector can have missed is told as `trouble` until the stop request shows it. When
    that request is then taken back somebody has looked for the product: the outputs are reset.

    Parameters
    ----------
    open_outputs : callable or None
        Opens the outputs; None for a machine without.
    """

    def __init__(self, open_outputs: Callable[[], MachineOutputs] | None) -> None:
        self._open = open_outputs
        self._outputs: MachineOutputs | None = None
        self._shown = ''  # what was missed, as far as the stop request shows it

    @property
    def exist(self) -> bool:
        """Whether the machine has outputs."""
        return self._open is not None

    @property
    def ready(self) -> bool:
        """Whether they can be switched, if there are any."""
        return self._outputs is None or not self._outputs.port_trouble

    def trouble(self, of_source: str) -> str:
        """Return what the line does not know yet or what still is wrong, in one line, else empty.

        Parameters
        ----------
        of_source : str
            What is wrong with load cell and photo-eyes.
        """
        port = '' if self._outputs is None else self._outputs.port_trouble
        missed = '' if self._outputs is None else self._outputs.missed
        # What is missed while something else is wrong is told as long as that: the request shows
        # what it was told last, and has to show it still when only that remains.
        if missed == self._shown and not (of_source or port):
            return ''
        return '; '.join(filter(None, (of_source, port, missed)))

    def open(self) -> None:
        """Open them, safe until `activate`."""
        if self._outputs is None and self._open is not None:
            self._outputs = self._open()

    def activate(self) -> None:
        """Leave the safe state."""
        if self._outputs is not None:
            self._outputs.activate()

    def safe(self) -> None:
        """Take the safe state."""
        if self._outputs is not None:
            self._outputs.safe()

    def close(self) -> None:
        """Take the safe state and let go of them."""
        if self._outputs is not None:
            self._outputs.close()
            self._outputs = None

    def edge(self, edge: EyeEdge) -> None:
        """Take an edge that was published."""
        if self._outputs is not None:
            self._outputs.edge(edge)

    def verdict(self, verdict: Verdict) -> None:
        """Take a verdict."""
        if self._outputs is not None:
            self._outputs.verdict(verdict)

    def hold(self, stop: bool) -> None:
        """Stop the line while the source does not work, whatever the stop request says."""
        if self._outputs is not None:
            self._outputs.hold(stop)

    def take_request(self, message: Any) -> None:
        """Take a stop request."""
        if self._outputs is None:
            return
        stop = message.state != StopRequest.RUN
        missed = self._outputs.missed
        if stop and message.reason == StopReason.DRIVER_TROUBLE and missed in message.hint:
            self._shown = missed
        elif stop and message.reason == StopReason.NOT_READY:
            self._shown = ''  # a reject that was started anew knows nothing of it
        elif not stop and self._shown:
            if self._shown == missed:
                self._outputs.reset()
            self._shown = ''
        self._outputs.stop_request(stop)

    def nobody_requests(self) -> None:
        """Stop the line until somebody says that it may run: nobody gives verdicts."""
        if self._outputs is not None:
            self._shown = ''
            self._outputs.stop_request(True)

    def reset(self) -> str:
        """Let the line run again after a product that can have been missed; return what was."""
        if self._outputs is None:
            return ''
        missed = self._outputs.missed
        self._outputs.reset()
        return missed

    def figures(self) -> dict[str, float]:
        """Return what was switched, and when."""
        return {} if self._outputs is None else self._outputs.figures()

    def finding(self) -> Finding:
        """Return the aspect Outputs."""
        outputs = self._outputs
        if outputs is None:
            return conclude('Outputs', 'not open' if self.exist else 'none', [])
        found = []
        if text := outputs.port_trouble:
            hint = 'check power, cable and address of the outputs; then call reset_stop_request'
            found.append(Concern(Level.ERROR, text, hint))
        elif text := outputs.missed:
            hint = 'look for the product; then call reset_stop_request'
            found.append(Concern(Level.ERROR, text, hint))
        belt = {None: 'unknown', True: 'yes', False: 'no'}[outputs.belt_runs]
        values: dict[str, float | str] = {
            name.replace(' ', '_'): value for name, value in outputs.figures().items()
        }
        return conclude('Outputs', 'switched as told', found, {**values, 'belt_runs': belt})
