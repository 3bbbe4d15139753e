# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Decoder of the binary frames of a digital load cell.

A frame is a 24-bit two's complement number with the most significant byte first, then the XOR of
its bytes or a status byte, then CR LF on some models. CR and LF also occur inside frames, so they
do not delimit frames.

A place is a position in the data at which frames may begin. The true place is a position at which
frames begin. Without CR LF, a valid XOR does not prove that a place is the true place, because
frames also seem valid at wrong places if the signal changes slowly. For example, in A B C X A B C X
with X = A ^ B ^ C, each byte is the XOR of the three bytes before it. Frames that are read one byte
late therefore seem valid unless the most significant byte A changes.

At a wrong place, a change d of the reading appears as a change of 256 d or more, with an error of
at most 255. If several frames seem valid at several places, the readings at the true place
therefore change least from frame to frame. A frame without CR LF is returned only if it and the
next four frames are valid, and if the readings at no other place change much less. A wrong byte
therefore also discards up to four earlier frames. A wrong place is accepted only if the signal does
not change for four frames. Frames that contain CR LF also before their end are checked like frames
without CR LF.
"""

import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_driver.serial.decoder import Decoded, Decoder

TRAILERS = ('auto', 'crlf', 'none')

# Number of bytes in a frame with and without CR LF.
_WITH_TRAILER, _WITHOUT = 6, 4
# Number of consecutive valid frames that are needed to accept a place.
_RUN = 5
# Changes with the sum `a` at one place are much smaller than changes with the sum `b` at another
# place, both in counts, if ``8 * a + 64 < b``.
_CLEARLY, _TINY = 8, 64
_AHEAD = _WITH_TRAILER * (_RUN + 1) - 1  # number of bytes that are needed to find the frame size
_OVERFLOW = 0b0111  # status bits of net, gross and converter overflow
_UNUSED = 0b1100_0000  # status bits that are always 0


class _Places:
    """Properties of the frames of one size that could begin at each byte of the data.

    `counts` contains the readings of the frames. All other attributes are boolean. `overflow` marks
    an overflow that the device reports, `good` marks valid frames, and `doubtful` marks frames that
    may seem valid at a wrong place. `run` marks places at which five consecutive frames are valid.
    `begins` marks places of `run` at which the readings change less than at all other places with
    valid frames. `slipped` marks places at which the readings change much more than at another
    place with valid frames. Each attribute is an array with one element for each position in the
    data from which one complete frame follows. For `run`, `begins` and `slipped`, five complete
    frames must follow.
    """

    def __init__(self, data: NDArray[np.uint8], size: int, checksum: bool) -> None:
        n = max(len(data) - size + 1, 0)
        a, b, c, check = (data[i : i + n] for i in range(4))
        high = a.astype(np.int32)
        self.counts: NDArray[np.int32] = (high << 16 | b.astype(np.int32) << 8 | c) - (
            (high >> 7) << 24
        )
        self.good: NDArray[np.bool_] = (a ^ b ^ c) == check if checksum else (check & _UNUSED) == 0
        if size == _WITH_TRAILER:
            self.good &= (data[4 : 4 + n] == ord('\r')) & (data[5 : 5 + n] == ord('\n'))
        self.overflow: NDArray[np.bool_] = (
            np.zeros(n, bool) if checksum else (check & _OVERFLOW) != 0
        )
        # At each place, `run` tells whether four consecutive frames are valid, and `change` is the
        # sum of the changes of their readings. Four frames that begin up to `size` - 1 bytes after
        # a place lie within its five frames, so places are compared over nearly the same bytes.
        k = max(len(data) - size * _RUN + 1, 0)
        run, change = self._runs(size, _RUN - 1, k + size - 1 if k else 0)
        last = slice(size * (_RUN - 1), size * (_RUN - 1) + k)
        self.run = run[:k] & self.good[last]
        # A place is not accepted while the changes at another place are as small or smaller. An
        # accepted place is rejected only if the changes at another place are much smaller, because
        # the changes at a wrong place are 256 times as large.
        self.slipped, unsure = np.zeros(k, bool), np.zeros(k, bool)
        all_change = change[:k] + np.abs(
            self.counts[last] - self.counts[size * (_RUN - 2) : size * (_RUN - 2) + k]
        )
        for i in range(1, size):
            other = slice(i, i + k)
            self.slipped |= run[other] & (_CLEARLY * change[other] + _TINY < change[:k])
            unsure |= run[other] & (change[other] <= all_change)
        self.begins = self.run & ~unsure
        # A frame with CR LF before its end is doubtful, because it may seem valid at a wrong place.
        if size == _WITH_TRAILER:
            inside = (data[: n + 2] == ord('\r')) & (data[1 : n + 3] == ord('\n'))
            self.doubtful = inside[:n] | inside[1 : n + 1] | inside[2 : n + 2]
        else:
            self.doubtful = np.ones(n, bool)

    def _runs(
        self, size: int, frames: int, places: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return two arrays with one element for each of the first `places` places.

        The elements are whether `frames` consecutive frames from the place on are valid, and the
        sum of the absolute changes of their readings from frame to frame.
        """
        starts = range(0, size * frames, size)
        run = np.logical_and.reduce([self.good[i : i + places] for i in starts])
        change = np.zeros(places, np.int64)
        for i in starts[1:]:
            change += np.abs(self.counts[i : i + places] - self.counts[i - size :][:places])
        return run, change


class FrameDecoder(Decoder):
    """Decoder of binary frames.

    With `checksum`, the fourth byte of a frame is the XOR of the first three. Without `checksum`,
    the fourth byte is the status of the device, and a wrong reading cannot be detected. `trailer`
    is 'crlf' if frames end with CR LF, 'none' if they do not, or 'auto' if this is unknown. Without
    `checksum`, 'auto' means 'crlf', and 'none' is not allowed, because the beginning of a frame
    could not be found.

    After an invalid frame, the decoder searches for the next place at which five consecutive frames
    are valid. The number of lost readings is computed from the number of skipped bytes, rounded up
    to whole frames. A loss of whole frames leaves no invalid frame, so only the sample clock can
    detect it.
    """

    def __init__(self, *, checksum: bool = True, trailer: str = 'auto') -> None:
        self._checksum = checksum
        unknown = 0 if checksum else _WITH_TRAILER
        self.frame_bytes = {'none': _WITHOUT, 'crlf': _WITH_TRAILER, 'auto': unknown}[trailer]
        self._data = np.zeros(0, np.uint8)
        self._synchronised = False
        self._since_frame = 0  # number of bytes skipped since the last frame
        self._begun = False  # whether a frame was found

    @property
    def waiting(self) -> int:
        """Number of received frames that are not returned yet, because later frames are needed."""
        return len(self._data) // (self.frame_bytes or _WITH_TRAILER)

    @property
    def missing(self) -> int:
        """Estimated number of bytes until the next frame is complete, at least 1.

        If the frame size is unknown, frames with CR LF are assumed.
        """
        size = self.frame_bytes or _WITH_TRAILER
        return size - len(self._data) % size

    def feed(self, data: bytes) -> Decoded:
        """Decode the next bytes of the stream; return the readings that are complete now."""
        self._data = np.concatenate((self._data, np.frombuffer(data, np.uint8)))
        position = 0 if self.frame_bytes else self._find_size()
        # Position of the first byte and number of frames of each run of valid frames.
        found: list[tuple[int, int]] = []
        lost: list[int] = []
        places = _Places(self._data, self.frame_bytes or _WITHOUT, self._checksum)
        while self.frame_bytes:
            if not self._synchronised:
                begin = self._first(places.begins, position)
                self._skip(begin - position)
                position = begin
                if begin >= len(places.begins):
                    break
                self._synchronised = True
                size = self.frame_bytes
                if places.doubtful[begin : begin + _RUN * size : size].any():
                    # If bytes were lost within the first five frames of a run, these frames may
                    # seem valid at a wrong place. Skip the five frames, because only the place
                    # after the frames is certain.
                    self._skip(_RUN * size)
                    position += _RUN * size
            number, broken = self._follow(places, position)
            if number:
                found.append((position, number))
                lost.append(math.ceil(self._since_frame / self.frame_bytes) if self._begun else 0)
                self._begun, self._since_frame = True, 0
                position += number * self.frame_bytes
            if not broken:
                break
            self.bad_frames += 1
            self._synchronised = False
            self._skip(1)
            position += 1
        self._data = self._data[position:].copy()
        return self._decoded(places, found, lost)

    def _find_size(self) -> int:
        """Set the frame size if the data determines it; return the number of skipped bytes."""
        with_trailer, without = (
            _Places(self._data, size, True) for size in (_WITH_TRAILER, _WITHOUT)
        )
        looked_at = max(len(self._data) - _AHEAD + 1, 0)
        # Check for frames with CR LF first, because they may also seem to be frames without CR LF.
        for position in range(looked_at):
            if with_trailer.run[position : position + _WITH_TRAILER].any():
                self.frame_bytes = _WITH_TRAILER
            elif without.begins[position]:
                self.frame_bytes = _WITHOUT
            else:
                continue
            self._skip(position)
            return position
        self._skip(looked_at)
        return looked_at

    @staticmethod
    def _first(mask: NDArray[np.bool_], begin: int) -> int:
        """Return the first position at or after `begin` that is true in `mask`.

        If no such position exists, the result is the length of `mask`, or `begin` if `begin` is
        beyond the end of `mask`.
        """
        rest = mask[begin:]
        return begin + int(rest.argmax()) if rest.any() else max(len(mask), begin)

    def _skip(self, number: int) -> None:
        self.skipped_bytes += number
        self._since_frame += number

    def _follow(self, places: _Places, position: int) -> tuple[int, bool]:
        """Return the number of valid frames in a run, and whether an invalid frame ends the run.

        The run begins at `position`. The run may also end with the data, or before a frame that can
        be checked only with later data.
        """
        k = len(places.run)
        good = places.good.copy()
        good[:k] &= ~places.doubtful[:k] | (places.run & ~places.slipped)
        steps = slice(position, None, self.frame_bytes)
        undecided = places.doubtful.copy()
        undecided[:k] = False
        good, undecided = good[steps], undecided[steps]
        stop = ~good | undecided
        if not stop.any():
            return len(stop), False
        number = int(stop.argmax())
        return number, not good[number]

    def _decoded(self, places: _Places, found: list[tuple[int, int]], lost: list[int]) -> Decoded:
        size = self.frame_bytes or _WITHOUT
        at = [first + size * np.arange(number) for first, number in found]
        missing = [
            np.r_[before, np.zeros(len(run) - 1)] for run, before in zip(at, lost, strict=True)
        ]
        rows = np.concatenate([np.zeros(0), *at]).astype(np.intp)
        lost_before = np.concatenate([np.zeros(0), *missing]).astype(np.int64)
        return Decoded(places.counts[rows], places.overflow[rows], lost_before)
