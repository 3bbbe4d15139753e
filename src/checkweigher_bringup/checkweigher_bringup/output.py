# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: a table of items on the screen, and files."""

from collections import Counter
import math
from pathlib import Path
from typing import TextIO

from checkweigher_bringup.errors import UserError, warn
from checkweigher_core.recording import Recording
from checkweigher_core.records import GRAMS, Decision
from checkweigher_core.whole_file import check_folder_of, is_stream
from checkweigher_dsp.signal.averages import RunningMoments
from checkweigher_recording.bags.reading import read_bag
from checkweigher_validation.accuracy.results import (
    TABLE_HEADER,
    ItemResult,
    summary,
    table_row,
)


def check_output_file(path: Path | None, overwrite: bool) -> None:
    """Raise an exception if a file cannot be written, or must not be replaced.

    Raises `UserError` if `path` is a folder, or exists while `overwrite` is False, and
    `OutputError` if its folder does not exist or cannot be written. Nothing is checked if `path` is
    None or the path of a stream, such as ``/dev/stdout``.
    """
    if path is None or is_stream(path):
        return
    if path.is_dir():
        raise UserError(f'{path}: is a folder, not a file to write to')
    if path.exists() and not overwrite:
        raise UserError(f'{path}: exists already; choose another name or add --overwrite')
    check_folder_of(path)


def with_warning(recording: Recording) -> Recording:
    """Print the warning of a recording, if any, on stderr, and return the recording."""
    if recording.warning:
        warn(recording.warning)
    return recording


def read_with_warning(path: Path, lane: str | None) -> Recording:
    """Read a bag with a progress bar, and return the recording of a lane.

    The warning of the recording, if any, is printed on stderr. `lane` is the namespace of the lane,
    or None for the only lane of the bag. Raises `BagError` as `read_bag` does.
    """
    return with_warning(read_bag(path, lane, progress=True))


class ItemTable:
    """Table on the screen with one line per item and a summary at the end.

    The stamp `origin` in ns is subtracted from the times in column t1. If `origin` is None, the
    stamp of the first item is used, and the header is printed when this item is shown. The table is
    written to `file`, by default to the standard output.
    """

    def __init__(self, origin: int | None = None, file: TextIO | None = None) -> None:
        self._origin = origin
        self._file = file
        self._decisions: Counter[Decision] = Counter()
        # The errors in g are not stored one by one, because a line may run for months.
        self._errors = RunningMoments()
        if origin is not None:
            self._print(TABLE_HEADER)

    @property
    def count(self) -> int:
        """Number of items that were shown."""
        return self._decisions.total()

    def show(self, result: ItemResult) -> ItemResult:
        """Print the line of an item, and return the item."""
        if self._origin is None:
            self._origin = result.estimate.t1 or result.estimate.t3 or 0
            self._print(TABLE_HEADER)
        self._decisions[result.verdict.decision] += 1
        if not math.isnan(result.error):
            self._errors.add(GRAMS * result.error)
        self._print(table_row(result, self._origin))
        return result

    def close(self) -> None:
        """Print the summary if the header of the table was printed."""
        if self._origin is not None:
            self._print(summary(self._decisions, self._errors))

    def _print(self, text: str) -> None:
        print(text, file=self._file, flush=self._file is None)
