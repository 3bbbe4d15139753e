# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the machine: what the driver and the inspection devices send."""

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records.quantities import MAX_MASS, MAX_SAMPLE_RATE, Stamp


class Eye(IntEnum):
    """The photo-eyes at the two ends of the weigh belt."""

    INFEED = 0
    OUTFEED = 1


class StreamState(IntEnum):
    """Whether a stream of samples goes on, has ended, or was broken off by its source."""

    RUNNING = 0
    FINISHED = 1
    FAILED = 2


@dataclass(frozen=True, slots=True)
class LoadCell:
    """A load cell, and how its readings become kilograms.

    `sample_rate` is in Hz, `capacity` in kg, `weigh_length` (from the infeed to the outfeed eye)
    in m. `counts_per_kg` is the static sensitivity, negative where the cell is mounted upside
    down, `zero_counts` the reading of the empty belt at calibration. A reading at or beyond
    `min_counts` or `max_counts` is saturated, a load of more than `capacity` on the empty belt an
    overload: the cell carries the dead load of the belt besides.

    Raises
    ------
    ValueError
        If a field cannot describe a load cell; the message names the field.
    """

    sample_rate: float
    counts_per_kg: float
    zero_counts: float
    min_counts: int
    max_counts: int
    capacity: float
    weigh_length: float
    model: str = ''
    serial_number: str = ''

    def __post_init__(self) -> None:
        for name, (least, most, unit) in _POSSIBLE.items():
            value = getattr(self, name)
            magnitude = abs(value) if name == 'counts_per_kg' else value
            span = f'{least:g}..{most:g} {unit}'
            _require(least <= magnitude <= most, f'{name} is {value:g}, must be within {span}')
        lower, upper, zero = self.min_counts, self.max_counts, self.zero_counts
        _require(lower < upper, f'min_counts {lower} is not below max_counts {upper}')
        span = f'min_counts..max_counts, {lower}..{upper}'
        _require(lower <= zero <= upper, f'zero_counts is {zero:g}, must be within {span}')

    @classmethod
    def of(cls, parameters: object, **others: Any) -> 'LoadCell':
        """Return the load cell that parameters of the same names and `others` describe."""
        names = [entry.name for entry in fields(cls) if hasattr(parameters, entry.name)]
        return cls(**{name: getattr(parameters, name) for name in names} | others)


# What a load cell of a belt scale, its converter and its belt can be; of counts_per_kg the size.
_POSSIBLE = {
    'sample_rate': (1.0, MAX_SAMPLE_RATE, 'Hz'),
    'counts_per_kg': (1e-3, 1e9, '/kg'),
    'min_counts': (-(2**31), 2**31 - 1, 'counts'),
    'max_counts': (-(2**31), 2**31 - 1, 'counts'),
    'capacity': (1e-6, MAX_MASS, 'kg'),
    'weigh_length': (1e-3, 100.0, 'm'),
}


def _require(condition: bool, text: str) -> None:
    if not condition:
        raise ValueError(f'load cell: {text}')


@dataclass(frozen=True, slots=True)
class SampleBlock:
    """Consecutive converter readings: `counts` (n,) int32, the first one taken at `stamp`.

    `first_index` is the index of ``counts[0]`` since the source started.
    """

    stamp: Stamp
    first_index: int
    counts: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class EyeEdge:
    """One edge of a photo-eye at `stamp`: `blocked` is its state from then on."""

    stamp: Stamp
    eye: Eye
    blocked: bool


@dataclass(frozen=True, slots=True)
class Reference:
    """The true mass of an item in kg; `stamp` is its t1. ValueError if it is no mass."""

    stamp: Stamp
    mass: float

    def __post_init__(self) -> None:
        if not 0 <= self.mass <= MAX_MASS:
            raise ValueError(f'a reference mass of {self.mass:g} kg, must be 0..{MAX_MASS:g} kg')


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """Progress of the driver or the segmenter in a stream, to which the driver gave a number.

    `stamp` is that of the last sample in ns; `samples` and `edges` were sent by the driver, or
    taken by the segmenter, which `items` have left. `text` is for a technician, empty while all
    is well. The segmenter has announced what the edges up to `last_edge`, in ns, show.
    """

    stamp: Stamp
    stream: int
    state: StreamState
    samples: int = 0
    edges: int = 0
    items: int = 0
    text: str = ''
    last_edge: Stamp | None = None


@dataclass(frozen=True, slots=True)
class MachineConditions:
    """What is wrong by the machine's inputs since `stamp` (ns).

    `conditions` are words of `StopReason`, each with the input of `inputs` that shows it. What is
    not `known`, since the inputs cannot be read, is wrong as well.
    """

    stamp: Stamp
    known: bool
    conditions: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ExternalReject:
    """An item that an inspection device has found bad.

    It is the item `item_id`, or if that is 0 the one that was at the `device` at `stamp`, ns.
    """

    stamp: Stamp | None
    device: str
    item_id: int = 0
    text: str = ''
