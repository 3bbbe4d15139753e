# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the zero before each item."""

from collections.abc import Mapping, Sequence
import math

import numpy as np

from checkweigher_core.records import GRAMS, NANOSECONDS
from checkweigher_core.records.reasons import Reason
from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.drawing import Drawing
from checkweigher_web.lane import Key, ShownItem
from checkweigher_web.views.fault_marks import Scene, empty_belt, runs
from checkweigher_web.views.view import FigureView


class ZeroView(FigureView):
    """The zero before each item, and the reading of the empty belt if the zero is out of range."""

    title = 'Zero'
    label = 'zero of the empty belt'

    @classmethod
    def _draw(cls, drawing: Drawing) -> Options:
        return zero_chart(drawing.items(), _read_empty_belts(drawing))


def _read_empty_belts(drawing: Drawing) -> dict[Key, float]:
    """Return the reading of the empty belt before each item with a zero out of range.

    The readings are in kg, or NaN without samples of the empty belt. All viewers share the
    readings, because the lane soon drops its samples.
    """
    readings: dict[Key, float] = drawing.once('readings', None, dict)
    cell = drawing.lane.load_cell
    items = {item.key: item for item in drawing.items() if _is_out(item)}
    for key in readings.keys() - items.keys():
        del readings[key]
    for key in items.keys() - readings.keys():
        item = drawing.lane.with_signals(items[key])
        found = empty_belt(Scene(item, item.stretch, cell)) if item.stretch and cell else None
        readings[key] = math.nan if found is None else found[2]
    return readings


def zero_chart(items: Sequence[ShownItem], readings: Mapping[Key, float]) -> Options:
    """Return the figure of the zero before each item, relative to the zero of calibration.

    The latest of `items` comes first. Areas mark the times with a zero out of range. Symbols show
    the `readings` of the empty belt in kg.
    """
    shown = [item for item in reversed(items) if _has_zero(item)]
    if not shown:
        return charts.nothing('no item yet')
    stamps = np.array([item.verdict.t1 for item in shown], np.int64)
    time = (stamps - stamps[0]) / NANOSECONDS
    zeros = GRAMS * np.array([_zero_of(item) for item in shown])
    line = charts.line('zero', time, zeros, DENOISED, width=2)
    name, last = Reason.ZERO_OUT_OF_RANGE.value, len(time) - 1
    out = runs([_is_out(item) for item in shown])
    # Each area extends from the item before these items to the item after them.
    spans = [(name, time[max(begin - 1, 0)], time[min(end, last)]) for begin, end in out]
    line['markArea'] = charts.red_areas(spans)
    series = [line]
    read = GRAMS * np.array([readings.get(item.key, math.nan) for item in shown])
    known = np.isfinite(read)
    if known.any():
        series.append(charts.symbols(f'as read, {name}', time[known], read[known], 'diamond', 10))
    figure = charts.figure(series, 's', 'g')
    figure['xAxis'] |= {'min': time[0], 'max': time[-1]}
    return figure


def _is_out(item: ShownItem) -> bool:
    return Reason.ZERO_OUT_OF_RANGE in item.verdict.reasons


def _has_zero(item: ShownItem) -> bool:
    return item.verdict.t1 is not None and (_is_out(item) or math.isfinite(_zero_of(item)))


def _zero_of(item: ShownItem) -> float:
    return math.nan if item.estimate is None else item.estimate.zero
