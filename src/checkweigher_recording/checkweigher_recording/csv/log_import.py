# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Import of CSV logs with the signal of a load cell and the states of photo-eyes."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
import math
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.recording import Event, Recording
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    Eye,
    EyeEdge,
    LoadCell,
    Reference,
    SampleBlock,
)
from checkweigher_recording.csv.edges_file import EdgesFile, read_edges_file
from checkweigher_recording.csv.table import Columns, CsvError, read_table

_INT32 = np.iinfo(np.int32)


@dataclass(frozen=True)
class ImportParameters(Parameters):
    """Parameters of the import of a log: its columns, and the calibration of its signal.

    A column is given by its name in the header row, or by its number, which counts from 0. The
    calibration is either the sensitivity `counts_per_kg`, or a line with mass = slope * signal +
    offset in g.

    Raises `ParameterError` if a value is out of range, if neither or both of the calibrations are
    given, if the scale is 0, if only one eye has a column, or if the decimal mark is also the
    separator.
    """

    node: ClassVar[str] = 'import'

    signal: str = parameter('', 'column of the signal; empty selects the only column')
    time: str = parameter('', 'column of the time in s; if empty, sample_rate is used')
    sample_rate: float = parameter(
        0.0,
        'sample rate; 0 selects the rate of the edges file or time column',
        unit='Hz',
        minimum=0.0,
        maximum=1e6,
    )
    delimiter: str = parameter(',', 'separator of columns', choices=(',', ';', 'tab', 'space'))
    decimal: str = parameter('.', 'decimal mark', choices=('.', ','))
    infeed: str = parameter('', 'column of the infeed eye; empty with an edges file')
    outfeed: str = parameter('', 'column of the outfeed eye; empty with an edges file')
    threshold: float = parameter(0.5, 'value of an eye column above which the eye is blocked')
    blocked_below: bool = parameter(
        False, 'whether an eye is blocked below the threshold instead of above it'
    )
    infeed_key: str = parameter('ftc1', 'key of the infeed eye in the edges file')
    outfeed_key: str = parameter('ftc2', 'key of the outfeed eye in the edges file')
    scale: float = parameter(
        1.0, 'counts per unit of the signal; rounding to whole counts limits the resolution'
    )
    slope: float = parameter(0.0, 'slope of the calibration: mass per unit of the signal', unit='g')
    offset: float = parameter(0.0, 'offset of the calibration: mass at signal 0', unit='g')
    counts_per_kg: float = parameter(0.0, 'static sensitivity, instead of slope', unit='1/kg')
    zero_counts: float = parameter(0.0, 'reading of the empty belt in counts, instead of offset')
    min_counts: int = parameter(
        int(_INT32.min),
        'lower limit of the converter in counts',
        minimum=_INT32.min,
        maximum=_INT32.max,
    )
    max_counts: int = parameter(
        int(_INT32.max),
        'upper limit of the converter in counts',
        minimum=_INT32.min,
        maximum=_INT32.max,
    )
    capacity: float = parameter(10.0, 'capacity of the load cell', unit='kg', minimum=1e-6)
    weigh_length: float = parameter(
        0.2, 'distance between infeed and outfeed eye', unit='m', minimum=0.001, maximum=100.0
    )
    model: str = parameter('', 'model of the load cell')
    serial_number: str = parameter('', 'serial number of the load cell')
    samples_per_block: int = parameter(10, 'samples per block', minimum=1, maximum=10_000)
    start_time: int = parameter(
        1_700_000_000,
        'time of the first sample since 1970',
        unit='s',
        minimum=0,
        maximum=2_000_000_000,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.slope == 0) == (self.counts_per_kg == 0):
            raise ParameterError('import.slope: give either slope or counts_per_kg, not equal to 0')
        if self.scale == 0:
            raise ParameterError('import.scale: is 0, but must differ from 0')
        if bool(self.infeed) != bool(self.outfeed):
            raise ParameterError('import.infeed: give the columns of both eyes, or of neither')
        if self.decimal == self.delimiter:
            raise ParameterError('import.decimal: is the delimiter; choose another one')

    def load_cell(self, sample_rate: float) -> LoadCell:
        """Return the load cell with these parameters and a sample rate in Hz.

        Raises `ParameterError` if a load cell cannot have these values.
        """
        calibration = {}
        if self.slope:
            calibration['counts_per_kg'] = self.scale * GRAMS / self.slope
            calibration['zero_counts'] = -self.scale * self.offset / self.slope
        try:
            return LoadCell.of(self, sample_rate=sample_rate, **calibration)
        except ValueError as error:
            raise ParameterError(f'import: {error}') from None


def import_csv(path: Path, parameters: ImportParameters, edges: Path | None = None) -> Recording:
    """Read a recording from a log, which is a CSV file with or without a header row.

    `edges` is the path of a JSON file with the edges of the photo-eyes, which is needed if the log
    has no columns of the eyes (see `edges_file.read_edges_file`). A gap in the time column of the
    log becomes a gap in the sample index of the recording.

    Raises `CsvError` if a file cannot be read or its content does not fit the parameters. Raises
    `ParameterError` if the parameters contradict each other or the edges file.
    """
    if (edges is None) == (not parameters.infeed):
        raise ParameterError('import.infeed: give either columns of the eyes or an edges file')
    separator = {'tab': '\t', 'space': None}.get(parameters.delimiter, parameters.delimiter)
    uses = ('signal', 'time', 'infeed', 'outfeed')
    columns = {use: name for use in uses if (name := getattr(parameters, use)) or use == 'signal'}
    table = read_table(path, columns, separator, parameters.decimal)
    keys = {Eye.INFEED: parameters.infeed_key, Eye.OUTFEED: parameters.outfeed_key}
    content = None if edges is None else read_edges_file(edges, keys, len(table.columns['signal']))
    clock = _clock(table, parameters, content)
    events: list[Event] = list(_blocks(table, clock, parameters))
    if content is None:
        for eye in Eye:
            events += _edges_of_column(table, clock, eye, parameters)
    else:
        events += _events_of_file(content, clock)
    return Recording.from_events(parameters.load_cell(clock.sample_rate), events)


@dataclass(frozen=True, slots=True)
class _Clock:
    """Sampling times of the rows of a log."""

    sample_rate: float  # sample rate in Hz
    index: NDArray[np.int64]  # sample index of each row, relative to the first row
    begin: int  # time of the first row in ns

    def stamp(self, row: float) -> int:
        """Return the time of a row in ns. For a fractional row, the time is interpolated linearly.

        A row beyond the last row has the time of the last row.
        """
        below = min(int(row), len(self.index) - 1)
        above = min(below + 1, len(self.index) - 1)
        begin, end = int(self.index[below]), int(self.index[above])
        return self.begin + round(
            (begin + (end - begin) * (row - below)) / self.sample_rate * NANOSECONDS
        )


def _clock(table: Columns, parameters: ImportParameters, content: EdgesFile | None) -> _Clock:
    """Return the sampling times of the rows, which lie on an evenly spaced grid.

    If the time column shows that rows are missing, the sample index increases by more than 1 there.

    Raises `CsvError` if the time column is not valid, and `ParameterError` if the sample rate is
    unknown.
    """
    rate, rows = _given_rate(parameters, content), len(table.columns['signal'])
    begin = parameters.start_time * NANOSECONDS
    time = table.columns.get('time')
    if time is None:
        if not rate:
            raise ParameterError('import.sample_rate: unknown; give it, or a time column')
        return _Clock(rate, np.arange(rows), begin)
    if rows < 2:
        raise CsvError(f'{table.path}: a single row is not a signal')
    step = np.diff(time)
    backward = np.flatnonzero(step <= 0)
    if len(backward):
        raise CsvError(f'{table.place(int(backward[0]) + 1)}: the time does not increase')
    # Each step is rounded separately, because small errors of the times could otherwise add up to a
    # gap.
    samples = np.rint(step * rate if rate else step / np.median(step)).astype(np.int64)
    double = np.flatnonzero(samples == 0)
    if len(double):
        raise CsvError(
            f'{table.place(int(double[0]) + 1)}: only {step[double[0]]:g} s after the row above; '
            'sample the signal evenly'
        )
    index = np.concatenate(([0], np.cumsum(samples)))
    return _Clock(rate or float(index[-1] / (time[-1] - time[0])), index, begin)


def _given_rate(parameters: ImportParameters, content: EdgesFile | None) -> float:
    """Return the sample rate of the parameters or the edges file in Hz, or 0 if none is given.

    Raises `ParameterError` if the parameters and the edges file give different sample rates.
    """
    given, of_file = parameters.sample_rate, content.sample_rate if content else None
    if given and of_file and not math.isclose(given, of_file, rel_tol=1e-6):
        raise ParameterError(
            f'import.sample_rate: {given:g} Hz, but the edges file says {of_file:g} Hz'
        )
    return given or of_file or 0.0


def _blocks(table: Columns, clock: _Clock, parameters: ImportParameters) -> Iterator[SampleBlock]:
    counts = np.rint(table.columns['signal'] * parameters.scale)
    beyond = np.flatnonzero((counts < _INT32.min) | (counts > _INT32.max))
    if len(beyond):
        raise CsvError(
            f'{table.place(int(beyond[0]))}: {counts[beyond[0]]:g} counts do not fit into 32 bits; '
            'choose a smaller scale'
        )
    holes = np.flatnonzero(np.diff(clock.index) > 1) + 1
    for begin, end in pairwise((0, *holes.tolist(), len(counts))):
        for first in range(begin, end, parameters.samples_per_block):
            last = min(first + parameters.samples_per_block, end)
            yield SampleBlock(
                clock.stamp(first), int(clock.index[first]), counts[first:last].astype(np.int32)
            )


def _edges_of_column(
    table: Columns, clock: _Clock, eye: Eye, parameters: ImportParameters
) -> Iterator[EyeEdge]:
    level = table.columns[eye.name.lower()]
    below, above = level < parameters.threshold, level > parameters.threshold
    blocked = below if parameters.blocked_below else above
    for row in np.flatnonzero(np.diff(blocked)) + 1:
        yield EyeEdge(clock.stamp(int(row)), eye, bool(blocked[row]))


def _events_of_file(content: EdgesFile, clock: _Clock) -> Iterator[Event]:
    masses = iter(content.masses)
    for eye, row, blocked in content.switches:
        stamp = clock.stamp(row)
        yield EyeEdge(stamp, eye, blocked)
        if content.masses and eye is Eye.INFEED and blocked:
            yield Reference(stamp, next(masses))
