"""When a process of the line is started again, and when it is taken for hung: policy alone."""

from dataclasses import dataclass
from enum import Enum, auto
import signal

CANNOT_START = 2  # exit status of a node whose parameters cannot be used


@dataclass(frozen=True, slots=True)
class Patience:
    """How patient the supervision is; all in s.

    Attributes
    ----------
    delay, longest_delay : float
        Before a process is started again: at first, and at most where it dies again and again.
    stable : float
        One that has lived for so long has not died at once.
    silence : float
        Without diagnostics after which a process is hung.
    start : float
        The same for one that was just started.
    """

    delay: float = 1.0
    longest_delay: float = 10.0
    stable: float = 5.0
    silence: float = 5.0
    start: float = 30.0


class Action(Enum):
    """What has to be done about a process."""

    NOTHING = auto()
    START = auto()
    KILL = auto()
    GIVE_UP = auto()


class Supervision:
    """State of one process, and what to do about it; times are s on a clock that never steps back.

    `reason` says why the process ended last.
    """

    def __init__(self, patience: Patience | None = None) -> None:
        self.reason = ''
        self._patience = patience or Patience()
        self._delay = self._patience.delay
        self._started: float | None = None
        self._ended: float | None = None
        self._heard: float | None = None
        self._was_up = False
        self._cannot_start = False
        self._hung = False

    def started(self, now: float) -> float:
        """Note that the process was started and return how long it was not there, s."""
        away = 0.0 if self._ended is None else now - self._ended
        self._started, self._ended, self._heard, self._hung = now, None, None, False
        return away

    def heard(self, now: float) -> None:
        """Note that diagnostics of the process came."""
        if self._ended is None and self._started is not None:
            self._heard, self._was_up = now, True

    def ended(self, now: float, status: int) -> None:
        """Note that the process has ended, with a status as of `subprocess`: -N for signal N."""
        if self._started is not None:
            at_once = now - self._started < self._patience.stable
            longer = min(2 * self._delay, self._patience.longest_delay)
            self._delay = longer if at_once and self.reason else self._patience.delay
        # Once it has worked, its parameters are good and it is worth another try.
        self._cannot_start = status == CANNOT_START and not self._was_up
        silence = f'hung: no diagnostics for {self._patience.silence:g} s'
        self.reason = silence if self._hung else _reason(status)
        self._started, self._ended = None, now

    def due(self, now: float) -> Action:
        """Return what has to be done now."""
        if self._started is None:
            if self._cannot_start:
                return Action.GIVE_UP
            waited = self._ended is None or now - self._ended >= self._delay
            return Action.START if waited else Action.NOTHING
        if self._heard is None:
            hung = now - self._started > self._patience.start
        else:
            hung = now - self._heard > self._patience.silence
        if hung and not self._hung:
            self._hung = True
            return Action.KILL
        return Action.NOTHING


def _reason(status: int) -> str:
    if status < 0:
        try:
            return f'killed by signal {-status} ({signal.Signals(-status).name})'
        except ValueError:
            return f'killed by signal {-status}'
    return f'ended with status {status}'
