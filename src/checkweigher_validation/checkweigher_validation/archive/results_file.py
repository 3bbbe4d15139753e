# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parquet file with the results of one bag and their origin."""

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
    # The type has no time zone, because DuckDB cannot subtract times with a time zone.
    ColumnType.TIME: pa.timestamp('ns'),
    ColumnType.NUMBER: pa.float64(),
    ColumnType.TEXT: pa.string(),
    ColumnType.TEXTS: pa.list_(pa.string()),
}
_KEY = 'checkweigher'  # key of origin and summary in the metadata of a file
_ROWS = 10_000  # number of rows that are written at once
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
    """Bag, parameters and program from which results were computed."""

    bag_sha256: str
    parameters_sha256: str
    lane: str  # namespace of the lane, or empty if the job named none
    program: str


@dataclass(frozen=True, slots=True)
class BagSummary:
    """Summary of the results of a bag.

    The fields from `accept` to `fault` are numbers of items. The mean error and the largest error
    are None if no weighed item has a known mass. The standard deviation of the errors is None if
    fewer than two weighed items have a known mass.
    """

    duration_s: float  # duration of the signal in s
    items: int
    accept: int
    under: int
    over: int
    fault: int
    mean_error_g: float | None
    std_dev_g: float | None
    largest_error_g: float | None
    notes: tuple[str, ...] = ()  # warnings, for example that the recording is incomplete


def write_results_file(path: Path, results: Iterable[ItemResult]) -> pq.ParquetWriter:
    """Write results to a Parquet file, and return its writer.

    The file is not complete until `finish` is called with the writer.
    """
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
    """Complete a Parquet file with the origin and the summary of its results."""
    text = json.dumps({'origin': asdict(origin), 'summary': asdict(summary)})
    writer.add_key_value_metadata({_KEY: text})
    writer.close()


def read_origin(path: Path) -> tuple[Origin, BagSummary] | None:
    """Return the origin and the summary that a results file contains.

    Returns None if the file does not exist, is not complete, or is not a results file.
    """
    with suppress(OSError, pa.ArrowException, KeyError, TypeError, ValueError):
        found = json.loads(pq.read_metadata(path).metadata[_KEY.encode()])
        summary = found['summary'] | {'notes': tuple(found['summary']['notes'])}
        return Origin(**found['origin']), BagSummary(**summary)
    return None
