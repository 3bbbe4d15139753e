"""When the next event of a recording or a simulation is due."""

from dataclasses import dataclass

from checkweigher_driver.recording import Event
from checkweigher_dsp.records import NANOSECONDS, SampleBlock


class Pacer:
    """Translate stamps into due times on another clock, at a chosen rate.

    Parameters
    ----------
    rate : float
        Seconds of signal in a second; 0 for no pace at all.
    sample_rate : float
        Hz; a block is due when its last sample has been taken.
    start : float
        s, when the first event is due.
    """

    def __init__(self, rate: float, sample_rate: float, start: float) -> None:
        self._rate = rate
        self._sample_rate = sample_rate
        self._start = start
        self._first_stamp: int | None = None

    def due(self, event: Event) -> float:
        """Return when an event is due, s."""
        if self._first_stamp is None:
            self._first_stamp = event.stamp
        if self._rate == 0:
            return self._start
        signal = (event.stamp - self._first_stamp) / NANOSECONDS
        if isinstance(event, SampleBlock):
            signal += len(event.counts) / self._sample_rate
        return self._start + signal / self._rate


@dataclass
class FlowControl:
    """How far the line may lag behind the driver before the driver waits.

    Counted in what the subscribers have said they have taken, so that it holds however deep or
    shallow the queues in between are.

    Attributes
    ----------
    max_duration : float
        s of signal; below the lateness of edges that the segmenter allows for.
    max_blocks : int
        Blocks, below the depth of the queue.
    max_items : int
        Items between segmenter and verdict.
    """

    max_duration: float = 1.0
    max_blocks: int = 500
    max_items: int = 100
    samples_sent: int = 0
    samples_taken: int = 0
    samples_missed: int = 0
    items_cut: int = 0
    items_judged: int = 0

    def taken(self, samples: int, items: int) -> None:
        """Note what the segmenter says it has taken and cut in all."""
        if samples < self.samples_taken:
            # A new segmenter has taken the place of one that was ended: it never saw the rest.
            self.samples_missed = self.samples_sent - samples
            self.items_judged = items
        self.samples_taken, self.items_cut = samples, items

    def may_send(self, block: SampleBlock, sample_rate: float) -> bool:
        """Tell whether a block may follow now."""
        ahead = self.samples_sent - self.samples_missed - self.samples_taken
        limit = min(self.max_duration * sample_rate, self.max_blocks * len(block.counts))
        return ahead <= limit and self.items_cut - self.items_judged <= self.max_items
