# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The interface of decoders, which turn the bytes of a serial stream into readings."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Decoded:
    """Values in the order of the stream, arrays of shape (n,)."""

    counts: NDArray[np.int32]
    overflow: NDArray[np.bool_]  # the device reports that its converter or scale was exceeded
    # Values that are missing between each reading and the one before it, at least 1 wherever bytes
    # were skipped.
    lost: NDArray[np.int64]


class Decoder(Protocol):
    """A stream of bytes in, readings out; any cut of the stream gives the same readings."""

    frame_bytes: int  # size of a reading on the wire, 0 while that is not known
    skipped_bytes: int  # part of no reading, so far
    bad_frames: int  # readings that were refused where one was expected, so far

    def feed(self, data: bytes) -> Decoded:
        """Take the next bytes of the stream and return the readings that they complete."""

    @property
    def waiting(self) -> int:
        """Whole readings that have come but are not returned yet."""

    @property
    def missing(self) -> int:
        """Bytes to come until the next reading is whole, or an estimate of that; at least 1."""
