"""What commands write: a table for the eye and a CSV file, the file whole or not at all."""

from collections.abc import Iterable, Sequence
from io import StringIO
from pathlib import Path
import sys

from checkweigher_bringup.errors import UserError
from checkweigher_recording.recording import Recording
from checkweigher_recording.whole_file import check_folder_of, write_whole
from checkweigher_validation.accuracy.results import (
    TABLE_HEADER,
    ItemResult,
    summary,
    table_row,
    write_csv,
)


def check_output_file(path: Path | None, overwrite: bool) -> None:
    """Raise UserError or OutputError if a file cannot be written: before the work, not after it."""
    if path is None:
        return
    if path.is_dir():
        raise UserError(f'{path}: is a folder, not a file to write to')
    if path.exists() and not overwrite:
        raise UserError(f'{path}: exists already; choose another name or add --overwrite')
    check_folder_of(path)


def warn_unfinished(recording: Recording) -> None:
    """Say so, beside the results, if a recording is only the beginning of one."""
    if recording.unfinished:
        print(recording.unfinished, file=sys.stderr, flush=True)


class CsvOutput:
    """A CSV file that is to be written when the work is done.

    Parameters
    ----------
    path : Path or None
        Where; with None nothing is written.
    overwrite : bool
        Whether a file that is there may be replaced.

    Raises
    ------
    UserError, OutputError
        If the file is there already or cannot be made: before the work, not after it.
    """

    def __init__(self, path: Path | None, overwrite: bool) -> None:
        self._path = path
        check_output_file(path, overwrite)

    def write(self, results: Iterable[ItemResult]) -> None:
        """Write all results, or raise OutputError and leave no file behind."""
        if self._path is None:
            return
        text = StringIO()
        write_csv(text, results)
        write_whole(self._path, text.getvalue())


class Table:
    """A table on the screen that grows by one line an item and ends with a summary.

    Parameters
    ----------
    origin : int
        ns, what the column t1 counts from.
    """

    def __init__(self, origin: int) -> None:
        self._origin = origin
        self._results: list[ItemResult] = []
        print(TABLE_HEADER, flush=True)

    def show(self, result: ItemResult) -> None:
        """Show one more item."""
        self.show_all([result])

    def show_all(self, results: Sequence[ItemResult]) -> None:
        """Show many items at once."""
        self._results += results
        rows = ''.join(f'{table_row(result, self._origin)}\n' for result in results)
        print(rows, end='', flush=True)

    def close(self) -> None:
        """Show the summary."""
        print(summary(self._results), flush=True)
