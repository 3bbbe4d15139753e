# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Results of one bag as a Parquet file: typed columns with units, and the origin of the results."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import islice
import json
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from checkweigher_validation.accuracy.columns import COLUMNS, ColumnType
from checkweigher_validation.accuracy.results import ItemResult

_TYPES = {
    ColumnType.WHOLE: pa.int64(),
    # Without a zone in the type, because DuckDB cannot subtract such times.
    ColumnType.TIME: pa.timestamp('ns'),
    ColumnType.NUMBER: pa.float64(),
    ColumnType.TEXT: pa.string(),
    ColumnType.TEXTS: pa.list_(pa.string()),
}
_KEY = 'checkweigher'  # of the metadata
_ROWS = 10_000  # written at once
SCHEMA = pa.schema(
    [
        pa.field(
            column.name,
            _TYPES[column.kind],
            metadata={'time_zone': 'UTC'}
            if column.kind is ColumnType.TIME
            else {'unit': column.unit},
        )
        for column in COLUMNS
    ]
)


@dataclass(frozen=True, slots=True)
class Origin:
    """Origin of results: SHA-256 of bag and parameters, lane, and program."""

    bag_sha256: str
    parameters_sha256: str
    lane: str
    program: str


@dataclass(frozen=True, slots=True)
class BagSummary:
    """Summary of a bag; an error is None if there are too few items of known mass."""

    duration_s: float  # of the signal
    items: int
    accept: int
    under: int
    over: int
    fault: int
    mean_error_g: float | None
    std_dev_g: float | None
    largest_error_g: float | None
    notes: tuple[str, ...] = ()  # the recording broke off, or may be damaged


def write_results_file(path: Path, results: Iterable[ItemResult]) -> pq.ParquetWriter:
    """Write the rows of a Parquet file as they arrive; `finish` completes the file."""
    writer = pq.ParquetWriter(path, SCHEMA, compression='zstd')
    results = iter(results)
    while rows := list(islice(results, _ROWS)):
        columns = [[column.value(row) for row in rows] for column in COLUMNS]
        arrays = [
            pa.array(values, field.type) for values, field in zip(columns, SCHEMA, strict=True)
        ]
        writer.write_table(pa.table(arrays, schema=SCHEMA))
    return writer


def finish(writer: pq.ParquetWriter, origin: Origin, summary: BagSummary) -> None:
    """Complete a file with the origin and the summary of its results."""
    text = json.dumps({'origin': asdict(origin), 'summary': asdict(summary)})
    writer.add_key_value_metadata({_KEY: text})
    writer.close()


def read_origin(path: Path) -> tuple[Origin, BagSummary] | None:
    """Return origin and summary of a file of results, None if the file is not complete."""
    with suppress(OSError, pa.ArrowException, KeyError, TypeError, ValueError):
        found = json.loads(pq.read_metadata(path).metadata[_KEY.encode()])
        summary = found['summary'] | {'notes': tuple(found['summary']['notes'])}
        return Origin(**found['origin']), BagSummary(**summary)
    return None
