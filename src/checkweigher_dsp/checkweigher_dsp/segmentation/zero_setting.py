"""Zeroing on demand: which stretch of empty belt is taken, and why none was."""

from dataclasses import dataclass

from checkweigher_dsp.records import NANOSECONDS, LoadCell, ZeroChange
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.sample_buffer import SampleBuffer
from checkweigher_dsp.segmentation.zero_tracking import ZeroTracker

_PATIENCE = 10.0  # s of signal


@dataclass(frozen=True, slots=True)
class ZeroAnswer:
    """Whether the belt was zeroed, what to or why not, and if it was, the two zeros."""

    done: bool
    text: str
    change: ZeroChange | None = None


class ZeroSetting:
    """Wait for an empty belt at rest that began after the request, and make it the zero.

    Parameters
    ----------
    load_cell : LoadCell
        Its calibration.
    parameters : SegmenterParameters
        The limits.
    begin : int
        Index of the sample from which on the belt is read.
    """

    def __init__(self, load_cell: LoadCell, parameters: SegmenterParameters, begin: int) -> None:
        self._load_cell = load_cell
        self._limits = parameters
        self._begin = begin
        self._why_not = 'the belt was not empty'

    def try_at(
        self,
        tracker: ZeroTracker,
        buffer: SampleBuffer,
        empty: tuple[int, int] | None,
        least: float,
    ) -> ZeroAnswer | None:
        """Zero, if the belt was empty long enough.

        Parameters
        ----------
        tracker : ZeroTracker
            Takes the zero.
        buffer : SampleBuffer
            The samples.
        empty : tuple of int or None
            First and one past the last index of a settled empty belt, None if it is not empty.
        least : float
            s, how long it must have been empty.

        Returns
        -------
        ZeroAnswer or None
            None while it is to be tried again.
        """
        rate = self._load_cell.sample_rate
        if empty is not None:
            begin, end = max(empty[0], self._begin), empty[1]
            count = min(end - begin, round(self._limits.zero_time * rate))
            if count >= max(2, round(least * rate)):
                answer = self._take(tracker, buffer, end - count, end)
                if answer is not None:
                    return answer
        if buffer.end - self._begin > (_PATIENCE + self._limits.edge_lateness) * rate:
            return ZeroAnswer(False, f'{self._why_not} within {_PATIENCE:g} s: not zeroed')
        return None

    def _take(
        self, tracker: ZeroTracker, buffer: SampleBuffer, begin: int, end: int
    ) -> ZeroAnswer | None:
        if not buffer.is_whole(begin, end):
            self._why_not = 'samples were lost'
            return None
        stamp, before = buffer.stamp_at(end), tracker.zero.counts
        reading = tracker.set(stamp / NANOSECONDS, buffer.read(begin, end))
        if reading is None:
            self._why_not = 'the empty belt was not at rest'
            return None
        cell = self._load_cell
        mass = (reading - cell.zero_counts) / cell.counts_per_kg
        if not tracker.is_in_range(reading):
            return ZeroAnswer(
                False,
                f'the empty belt reads {mass:.6f} kg, beyond zero_range '
                f'{self._limits.zero_range:g} kg: not zeroed',
            )
        change = ZeroChange(
            stamp,
            mass,
            (before - cell.zero_counts) / cell.counts_per_kg,
            tracker.zero.std_dev / abs(cell.counts_per_kg),
        )
        text = f'zeroed at {mass:.6f} kg from the zero of calibration'
        return ZeroAnswer(True, text, change)
