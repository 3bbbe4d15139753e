# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The interface of decoders, which turn the bytes of a serial stream into readings."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Decoded:
    """Values in the order of the stream, arrays of shape (n,)."""

    counts: NDArray[np.int32]
    overflow: NDArray[np.bool_]  # the device reports that its converter or scale was exceeded
    # Number of values lost before each reading, at least 1 if bytes were skipped there.
    lost: NDArray[np.int64]


class Decoder(ABC):
    """Decoder of a stream of bytes; its division into reads does not change the readings."""

    frame_bytes = 0  # size of a reading on the wire, 0 while it is not known
    skipped_bytes = 0  # bytes so far that belong to no reading
    bad_frames = 0  # readings so far that were refused

    @abstractmethod
    def feed(self, data: bytes) -> Decoded:
        """Process the next bytes of the stream and return the readings that they complete."""

    @property
    @abstractmethod
    def waiting(self) -> int:
        """Number of complete readings that are not returned yet."""

    @property
    @abstractmethod
    def missing(self) -> int:
        """Number of bytes until the next reading is complete, at least 1; it may be an estimate."""
