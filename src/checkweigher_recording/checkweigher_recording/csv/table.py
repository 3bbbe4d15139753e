# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader for columns of numbers in a CSV file."""

from array import array
from collections.abc import Iterator, Mapping, Sequence
import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.input_files import read_input


class CsvError(ValueError):
    """Raised if a file cannot be imported. The message names the file and the fault."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of a CSV file."""

    path: Path
    columns: dict[str, NDArray[np.float64]]  # finite values, (n,), by the use of the column
    _line_numbers: 'array[int]'  # number of the line of each row, from 0

    def place(self, row: int) -> str:
        """Return ``path:line`` of a row for an error message. Lines are counted from 1."""
        return f'{self.path}:{self._line_numbers[row] + 1}'


def read_table(
    path: Path, columns: Mapping[str, str], delimiter: str | None, decimal: str
) -> Columns:
    """Read columns of a CSV file. The first row is a header unless all its cells are numbers.

    Blank lines are skipped. `columns` maps each use of a column, such as ``signal``, to the name or
    the number (from 0) of the column. An empty name stands for the only column of the file. If
    `delimiter` is None, columns are separated by white space. `decimal` is the decimal mark.

    Raises `CsvError` if the file cannot be read or has no values, a column is missing or ambiguous,
    or a value is not a finite number.
    """
    lines = read_text(path, 'utf-8-sig').splitlines()
    numbers = array('q', (number for number, line in enumerate(lines) if line.strip()))
    if not numbers:
        raise CsvError(f'{path}: empty')
    cells = _cells(lines[numbers[0]], delimiter)
    header = [] if all(_is_number(cell, decimal) for cell in cells) else cells
    if header:
        del numbers[0]
    places = [_column(path, use, name, header, len(cells)) for use, name in columns.items()]
    values = _parse(path, lines, numbers, places, delimiter, decimal)
    table = Columns(path, dict(zip(columns, values.T, strict=True)), numbers)
    broken = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if len(broken):
        raise CsvError(f'{table.place(int(broken[0]))}: a value is not finite')
    return table


def read_text(path: Path, encoding: str) -> str:
    """Return the content of a text file.

    Raises `CsvError` if the file cannot be read, or is not in the given encoding.
    """
    try:
        return read_input(path).decode(encoding)
    except OSError as error:
        raise CsvError(f'{path}: cannot be read: {error.strerror or error}') from None
    except UnicodeDecodeError as error:
        raise CsvError(f'{path}: not a text file: byte {error.start} is not UTF-8') from None


def _cells(line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error:
        return [line]  # the line has a cell that exceeds the size limit of the module csv


def _is_number(cell: str, decimal: str) -> bool:
    try:
        float(cell.replace(decimal, '.'))
    except ValueError:
        return False
    return True


def _column(path: Path, use: str, name: str, header: list[str], width: int) -> int:
    listed = ', '.join(header) if header else f'0 to {width - 1}, without names'
    if not name:
        if width != 1:
            raise CsvError(f'{path}: no column is named for the {use}; the file has {listed}')
        return 0
    if name in header:
        if header.count(name) > 1:
            raise CsvError(f'{path}: has several columns {name!r}; choose one by its number from 0')
        return header.index(name)
    if name.isdecimal() and int(name) < width:
        return int(name)
    raise CsvError(f'{path}: has no column {name!r} for the {use}; it has {listed}')


def _parse(
    path: Path,
    lines: Sequence[str],
    numbers: 'array[int]',
    places: list[int],
    delimiter: str | None,
    decimal: str,
) -> NDArray[np.float64]:
    """Return the values of the lines `numbers` in the columns `places`, (n, m).

    Raises `CsvError` if there are no lines, a line has too few columns, or a cell is not a number.
    """
    if not numbers:
        raise CsvError(f'{path}: no rows below the header')

    def rows() -> Iterator[str]:
        return (lines[number].replace(decimal, '.') for number in numbers)

    try:
        return np.loadtxt(
            rows(), delimiter=delimiter, usecols=places, ndmin=2, comments=None, quotechar='"'
        )
    except ValueError as error:
        # Find the line of the error, because numpy names only the number of the row.
        for number, row in zip(numbers, rows(), strict=True):
            if problem := _problem(_cells(row, delimiter), places):
                raise CsvError(f'{path}:{number + 1}: {problem}') from None
        raise CsvError(f'{path}: {error}') from None


def _problem(cells: list[str], places: list[int]) -> str:
    for place in places:
        if place >= len(cells):
            return f'{len(cells)} columns, but at least {place + 1} are needed'
        if not _is_number(cells[place], '.'):
            return f'{cells[place]!r} is not a number'
    return ''
