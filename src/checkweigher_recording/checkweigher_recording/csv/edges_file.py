# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader for a JSON file with the edges of the photo-eyes that belong to a CSV log."""

from dataclasses import dataclass
from itertools import pairwise
import json
from pathlib import Path
from typing import Any

from checkweigher_core.records import GRAMS, Eye
from checkweigher_recording.csv.table import CsvError, read_text

_LARGEST_NUMBER = 1e15  # exclusive upper limit of the magnitude of the numbers in the file


@dataclass(frozen=True, slots=True)
class EdgesFile:
    """Content of an edges file."""

    # For each edge: the eye, the row of the log, and whether the eye is blocked from that row on.
    switches: tuple[tuple[Eye, float, bool], ...]
    masses: tuple[float, ...]  # true masses of the items in kg, in order of entry, or empty
    sample_rate: float | None  # sample rate in Hz, or None if the file does not contain it


def read_edges_file(path: Path, keys: dict[Eye, str], rows: int) -> EdgesFile:
    """Read an edges file for a log that has `rows` rows.

    The file is a JSON object. `keys` maps each eye to its key in this object. The value of the key
    is a list of pairs ``[row, level]``. From the row of a pair on, the eye is blocked if the level
    is 1, and clear if the level is 0. The first pair is the state at the start of the log, and the
    others are edges. The rows increase, and may be fractional; the levels alternate. The optional
    key ``sample_rate_hz`` contains the sample rate in Hz. The optional key ``mass_g`` contains the
    true mass in g, either as one number for all items or as a list with one number for each item.
    There is one item for each edge to level 1 of the infeed eye.

    Raises `CsvError` if the file cannot be read or has a different form.
    """
    text = read_text(path, 'utf-8')
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise CsvError(f'{path}: not JSON: {error}') from None
    if not isinstance(content, dict):
        raise CsvError(f'{path}: not an edges file: must be an object with a list for each eye')
    switches = tuple(
        (eye, row, blocked)
        for eye, key in keys.items()
        for row, blocked in _switches(f'{path}: {key}', content.get(key), rows)
    )
    items = sum(eye is Eye.INFEED and blocked for eye, _, blocked in switches)
    return EdgesFile(switches, _masses(path, content, items), _sample_rate(path, content))


def _switches(where: str, entries: Any, rows: int) -> list[tuple[float, bool]]:
    if not isinstance(entries, list) or not entries:
        raise CsvError(f'{where}: must be a list of [row, level]')
    for entry in entries:
        _check_entry(where, entry, rows)
    for before, entry in pairwise(entries):
        if entry[0] <= before[0] or entry[1] == before[1]:
            raise CsvError(
                f'{where}: {entry!r} does not follow {before!r}: the row must increase, and the '
                'level must change'
            )
    return [(row, bool(level)) for row, level in entries[1:]]


def _check_entry(where: str, entry: Any, rows: int) -> None:
    if not (isinstance(entry, list) and len(entry) == 2 and entry[1] in (0, 1)):
        raise CsvError(f'{where}: {entry!r} is not [row, level] with level 0 or 1')
    if not _is_number(entry[0]) or not 0 <= entry[0] < rows:
        raise CsvError(f'{where}: row {entry[0]!r} is not in 0..{rows - 1}')


def _masses(path: Path, content: dict[str, Any], items: int) -> tuple[float, ...]:
    given = content.get('mass_g')
    if given is None:
        return ()
    masses = given if isinstance(given, list) else [given] * items
    if len(masses) != items:
        raise CsvError(f'{path}: mass_g: {len(masses)} masses for {items} items')
    for mass in masses:
        if not _is_number(mass) or mass < 0:
            raise CsvError(f'{path}: mass_g: {mass!r} is not a mass in g')
    return tuple(mass / GRAMS for mass in masses)


def _sample_rate(path: Path, content: dict[str, Any]) -> float | None:
    rate = content.get('sample_rate_hz')
    if rate is None:
        return None
    if not _is_number(rate) or rate <= 0:
        raise CsvError(f'{path}: sample_rate_hz: {rate!r} is not a rate in Hz')
    return float(rate)


def _is_number(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return -_LARGEST_NUMBER < value < _LARGEST_NUMBER  # False for NaN
