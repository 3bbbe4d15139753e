# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Interface of the decoders, which convert the bytes of a serial stream to readings."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Decoded:
    """Readings in the order of the stream, as arrays of shape (n,)."""

    counts: NDArray[np.int32]
    overflow: NDArray[np.bool_]  # whether the device reports an overflow of converter or scale
    lost: NDArray[np.int64]  # number of readings lost between each reading and the one before it


class Decoder(ABC):
    """Decoder of a byte stream.

    The readings do not depend on how the stream is divided into calls of `feed`.
    """

    frame_bytes = 0  # size of a reading in bytes; 0 as long as it is unknown
    skipped_bytes = 0  # number of bytes so far that belong to no reading
    bad_frames = 0  # number of readings so far that were refused

    @abstractmethod
    def feed(self, data: bytes) -> Decoded:
        """Decode the next bytes of the stream; return the readings that are complete now."""

    @property
    @abstractmethod
    def waiting(self) -> int:
        """Number of received readings that `feed` has not returned yet."""

    @property
    @abstractmethod
    def missing(self) -> int:
        """Estimated number of bytes until the next reading is complete, at least 1."""
