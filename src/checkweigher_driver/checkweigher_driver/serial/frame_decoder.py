# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Readings from the binary frames of a digital load cell: three bytes, a check, perhaps CR LF.

A frame is a 24-bit two's complement number, most significant byte first, then the XOR of the three
or a status byte, then CR LF on some models. CR and LF occur inside frames as well, so newlines
divide nothing.

Without CR LF the XOR does not tell where a frame begins. Of a signal that changes slowly three of
four places look right: in A B C X A B C X with X = A ^ B ^ C each byte is the XOR of the three
before it, and the place one byte on is wrong only where A changes. But read from a wrong place a
change d of the count becomes 256 d or more, give or take 255: of the places at which all is right
over some frames, the true one is that with the smallest change from frame to frame. So a frame
without CR LF is returned only when it and the four after it are good and no other place has smaller
changes; a disturbed byte costs the frames before it as well. A wrong place passes only while the
signal stands still for four frames. Frames with CR LF both inside and at their end are treated the
same way.
"""

import math

import numpy as np
from numpy.typing import NDArray

from checkweigher_driver.serial.decoder import Decoded

TRAILERS = ('auto', 'crlf', 'none')

_WITH_TRAILER, _WITHOUT = 6, 4  # bytes in a frame
_RUN = 5  # good frames in a row that make a place the true one
_CLEARLY, _TINY = 8, 64  # by how much smoother another place must be, and counts
_AHEAD = _WITH_TRAILER * (_RUN + 1) - 1  # bytes that finding the size looks at
_OVERFLOW = 0b0111  # net, gross and converter overflow
_UNUSED = 0b1100_0000  # bits of the status byte


class _Places:
    """The frames of one size that would begin at each byte of some data."""

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
        # Of the run of frames that begins at each byte: whether all are good, and how much they
        # change. Other places are looked at only within this run: where it is whole,
        # their bytes are.
        k = max(len(data) - size * _RUN + 1, 0)
        run, change = self._runs(size, _RUN - 1, k + size - 1 if k else 0)
        last = slice(size * (_RUN - 1), size * (_RUN - 1) + k)
        self.run = run[:k] & self.good[last]
        # Two measures. To begin, all changes, also those at the true place: in doubt
        # it is put off. To go on, only what a wrong place makes of them: 256 times as much.
        self.slipped, unsure = np.zeros(k, bool), np.zeros(k, bool)
        all_change = change[:k] + np.abs(
            self.counts[last] - self.counts[size * (_RUN - 2) : size * (_RUN - 2) + k]
        )
        for i in range(1, size):
            other = slice(i, i + k)
            self.slipped |= run[other] & (_CLEARLY * change[other] + _TINY < change[:k])
            unsure |= run[other] & (change[other] <= all_change)
        self.begins = self.run & ~unsure
        # Whether a frame could be misplaced and still good: where CR LF is inside it.
        if size == _WITH_TRAILER:
            inside = (data[: n + 2] == ord('\r')) & (data[1 : n + 3] == ord('\n'))
            self.doubtful = inside[:n] | inside[1 : n + 1] | inside[2 : n + 2]
        else:
            self.doubtful = np.ones(n, bool)

    def _runs(
        self, size: int, frames: int, places: int
    ) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Return whether so many frames in a row are good, and the sum of their changes."""
        starts = range(0, size * frames, size)
        run = np.logical_and.reduce([self.good[i : i + places] for i in starts])
        change = np.zeros(places, np.int64)
        for i in starts[1:]:
            change += np.abs(self.counts[i : i + places] - self.counts[i - size :][:places])
        return run, change


class FrameDecoder:
    """Readings from frames; any cut of the stream gives the same readings.

    With `checksum` the fourth byte is the XOR of the three before it; else it is the status, and a
    disturbed byte inside a frame cannot be noticed. `trailer` tells whether CR LF follows: 'crlf',
    'none', or 'auto' for finding out. Raises ValueError without either: frames could not be told
    apart.

    Where a frame is bad, the search goes on from its second byte. Frames are found again from the
    first place on at which five in a row are good.

    The number of values lost is that of the bytes skipped, rounded up to whole frames: right for
    disturbed bytes and for the loss of less than a frame, else too small. Whole frames that are
    missing leave no trace here; only the clock of the samples shows them.
    """

    def __init__(self, *, checksum: bool = True, trailer: str = 'auto') -> None:
        if trailer not in TRAILERS:
            raise ValueError(f'trailer: {trailer!r} is not one of {", ".join(TRAILERS)}')
        if not checksum and trailer == 'none':
            raise ValueError('neither a checksum nor CR LF: frames could not be told apart')
        self._checksum = checksum
        self.frame_bytes = 0
        if trailer == 'none':
            self.frame_bytes = _WITHOUT
        elif trailer == 'crlf' or not checksum:
            self.frame_bytes = _WITH_TRAILER
        self._data = np.zeros(0, np.uint8)
        self._synchronised = False
        self._since_frame = 0  # bytes skipped since the last frame
        self._begun = False  # whether there was one
        self.skipped_bytes = 0
        self.bad_frames = 0

    @property
    def waiting(self) -> int:
        """Whole frames that have come but wait for what follows them."""
        return len(self._data) // (self.frame_bytes or _WITH_TRAILER)

    @property
    def missing(self) -> int:
        """Bytes to come until the next frame is whole."""
        size = self.frame_bytes or _WITH_TRAILER
        return size - len(self._data) % size

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream and return the readings that they complete."""
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
                    # Where bytes are lost within this run, it may begin at a wrong place and
                    # still be good: the place is the true one only from then on.
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
        """Try both sizes; return the bytes that are then passed over."""
        with_trailer, without = (
            _Places(self._data, size, True) for size in (_WITH_TRAILER, _WITHOUT)
        )
        looked_at = max(len(self._data) - _AHEAD + 1, 0)
        # Frames with CR LF may look like some without; the reverse takes CR LF at six places.
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
        """Return the first position from `begin` on that is set, or the end."""
        rest = mask[begin:]
        return begin + int(rest.argmax()) if rest.any() else max(len(mask), begin)

    def _skip(self, number: int) -> None:
        self.skipped_bytes += number
        self._since_frame += number

    def _follow(self, places: _Places, position: int) -> tuple[int, bool]:
        """Return how many good frames follow, and whether a bad one ends them."""
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
        at = np.concatenate(
            [np.zeros(0, np.intp), *(first + size * np.arange(n) for first, n in found)]
        ).astype(np.intp)
        missing = np.zeros(len(at), np.int64)
        if found:
            missing[np.cumsum([0] + [n for _, n in found[:-1]])] = lost
        return Decoded(places.counts[at], places.overflow[at], missing)
