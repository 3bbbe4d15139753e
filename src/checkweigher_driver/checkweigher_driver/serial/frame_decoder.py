# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Readings from the binary frames of a digital load cell: three bytes, a check, perhaps CR LF.

A frame is a 24-bit two's complement number, most significant byte first, then the XOR of its bytes
or a status byte, then CR LF on some models. CR and LF occur inside frames, too, so they do not
delimit frames.

Without CR LF, the XOR does not show where a frame begins. If the signal changes slowly, three of
four places look right: in A B C X A B C X with X = A ^ B ^ C, each byte is the XOR of the three
before it, and the place one byte later is wrong only if A changes. But at a wrong place, a change d
of the count becomes 256 d or more, give or take 255. So of the places that look right over some
frames, the true one has the smallest changes from frame to frame. A frame without CR LF is returned
only if it and the next four are good and no other place has smaller changes, so a disturbed byte
costs the frames before it, too. A wrong place is accepted only if the signal does not change for
four frames. Frames with CR LF both inside and at their end are treated in the same way.
"""

import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_driver.serial.decoder import Decoded, Decoder

TRAILERS = ('auto', 'crlf', 'none')

_WITH_TRAILER, _WITHOUT = 6, 4  # bytes in a frame
_RUN = 5  # good frames in a row at the true place
_CLEARLY, _TINY = 8, 64  # ratio and counts by which another place must be smoother
_AHEAD = _WITH_TRAILER * (_RUN + 1) - 1  # bytes needed to find the size
_OVERFLOW = 0b0111  # net, gross and converter overflow
_UNUSED = 0b1100_0000  # bits of the status byte


class _Places:
    """Frames of one size, as if one began at each byte of some data."""

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
        # For the run of frames from each byte: whether all are good, and the sum of their changes.
        # Other places are checked only within this run, whose bytes have all come.
        k = max(len(data) - size * _RUN + 1, 0)
        run, change = self._runs(size, _RUN - 1, k + size - 1 if k else 0)
        last = slice(size * (_RUN - 1), size * (_RUN - 1) + k)
        self.run = run[:k] & self.good[last]
        # Two measures. A run does not begin while the changes at another place are as small. After
        # that, only a place with much smaller changes counts, because a slip makes the changes 256
        # times as large.
        self.slipped, unsure = np.zeros(k, bool), np.zeros(k, bool)
        all_change = change[:k] + np.abs(
            self.counts[last] - self.counts[size * (_RUN - 2) : size * (_RUN - 2) + k]
        )
        for i in range(1, size):
            other = slice(i, i + k)
            self.slipped |= run[other] & (_CLEARLY * change[other] + _TINY < change[:k])
            unsure |= run[other] & (change[other] <= all_change)
        self.begins = self.run & ~unsure
        # A frame with CR LF inside can be misplaced and still look good.
        if size == _WITH_TRAILER:
            inside = (data[: n + 2] == ord('\r')) & (data[1 : n + 3] == ord('\n'))
            self.doubtful = inside[:n] | inside[1 : n + 1] | inside[2 : n + 2]
        else:
            self.doubtful = np.ones(n, bool)

    def _runs(
        self, size: int, frames: int, places: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return whether a number of frames in a row are good, and the sum of their changes."""
        starts = range(0, size * frames, size)
        run = np.logical_and.reduce([self.good[i : i + places] for i in starts])
        change = np.zeros(places, np.int64)
        for i in starts[1:]:
            change += np.abs(self.counts[i : i + places] - self.counts[i - size :][:places])
        return run, change


class FrameDecoder(Decoder):
    """Readings from frames; the division of the stream into reads does not change them.

    With `checksum` the fourth byte is the XOR of the three before it. Otherwise it is the status,
    and a disturbed byte inside a frame cannot be detected. `trailer` is 'crlf' if CR LF follows,
    'none' if not, or 'auto' to find out. Without a checksum, `trailer` must not be 'none', because
    the bounds of frames could not be found.

    After a bad frame the search continues from its second byte, up to the first place at which five
    frames in a row are good.

    The number of lost values is the number of skipped bytes, rounded up to whole frames. It is
    right for disturbed bytes and for the loss of less than a frame, and too small otherwise. Only
    the clock of the samples can show a loss of whole frames.
    """

    def __init__(self, *, checksum: bool = True, trailer: str = 'auto') -> None:
        self._checksum = checksum
        unknown = 0 if checksum else _WITH_TRAILER
        self.frame_bytes = {'none': _WITHOUT, 'crlf': _WITH_TRAILER, 'auto': unknown}[trailer]
        self._data = np.zeros(0, np.uint8)
        self._synchronised = False
        self._since_frame = 0  # bytes skipped since the last frame
        self._begun = False  # whether there was a frame

    @property
    def waiting(self) -> int:
        """Number of whole frames that wait for the frames after them."""
        return len(self._data) // (self.frame_bytes or _WITH_TRAILER)

    @property
    def missing(self) -> int:
        """Number of bytes until the next frame is complete."""
        size = self.frame_bytes or _WITH_TRAILER
        return size - len(self._data) % size

    def feed(self, data: bytes) -> Decoded:
        """Process the next bytes of the stream and return the readings that they complete."""
        self._data = np.concatenate((self._data, np.frombuffer(data, np.uint8)))
        position = 0 if self.frame_bytes else self._find_size()
        found: list[tuple[int, int]] = []  # first byte and number of the frames
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
                    # If bytes were lost within this run, it may look good at a wrong place. Only
                    # the place after it is certain.
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
        """Set the frame size if it is clear, and return the number of skipped bytes."""
        with_trailer, without = (
            _Places(self._data, size, True) for size in (_WITH_TRAILER, _WITHOUT)
        )
        looked_at = max(len(self._data) - _AHEAD + 1, 0)
        # Frames with CR LF may look like frames without. The reverse needs CR LF at six places.
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
        """Return the first true position from `begin` on, or the end."""
        rest = mask[begin:]
        return begin + int(rest.argmax()) if rest.any() else max(len(mask), begin)

    def _skip(self, number: int) -> None:
        self.skipped_bytes += number
        self._since_frame += number

    def _follow(self, places: _Places, position: int) -> tuple[int, bool]:
        """Return the number of good frames that follow, and whether a bad frame ends them."""
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
