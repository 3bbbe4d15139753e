# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Units, limits and stamps that all records share."""

from datetime import UTC, datetime
import math
from typing import Annotated

# After a restart, the segmenter continues the item numbers at the next multiple of this number.
NUMBERS_AT_ONCE = 1_000
GRAMS = 1000.0  # grams per kilogram
NANOSECONDS = 1_000_000_000  # nanoseconds per second
MAX_SAMPLE_RATE = 1e6  # largest sample rate in Hz, limited by the memory
MAX_MASS = 1e6  # largest mass in kg
MAX_WINDOW = 2**16  # largest number of samples in a window or a message
Stamp = Annotated[int, 'ns']  # time in ns since 1970


def utc(stamp: int) -> str:
    """Return a stamp as an ISO 8601 time in UTC with microseconds."""
    return datetime.fromtimestamp(stamp / NANOSECONDS, UTC).isoformat(timespec='microseconds')


def local_time(stamp: int) -> datetime:
    """Return a stamp as a local time of this computer, with the UTC offset at that time."""
    return datetime.fromtimestamp(stamp / NANOSECONDS, UTC).astimezone()


def seconds(stamp: int | None) -> float:
    """Return a stamp in s, or NaN if it is unknown."""
    return math.nan if stamp is None else stamp / NANOSECONDS
