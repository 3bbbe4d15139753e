# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the machine, which the driver and the inspection devices send."""

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
    """State of a stream of samples; FAILED means that its source has failed."""

    RUNNING = 0
    FINISHED = 1
    FAILED = 2


@dataclass(frozen=True, slots=True)
class LoadCell:
    """A load cell, and the conversion of its readings to kilograms.

    Attributes
    ----------
    sample_rate : float
        Samples per second, in Hz.
    counts_per_kg : float
        Static sensitivity; negative if the cell is mounted upside down.
    zero_counts : float
        Reading of the empty belt at calibration.
    min_counts, max_counts : int
        Limits of the converter. A reading at or beyond a limit is saturated.
    capacity : float
        Largest load in kg on the empty belt. The cell carries the dead load of the belt as well.
    weigh_length : float
        Distance from the infeed eye to the outfeed eye in m.
    model, serial_number : str
        Identification; empty if unknown.

    Raises
    ------
    ValueError
        If a value is impossible for a load cell; the message names the field.
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
        """Return a load cell from the parameters named like its fields, and from `others`."""
        names = [entry.name for entry in fields(cls) if hasattr(parameters, entry.name)]
        return cls(**{name: getattr(parameters, name) for name in names} | others)


# Range of each field; for counts_per_kg, of its magnitude.
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
    """Consecutive converter readings.

    `counts` has shape (n,), int32. ``counts[0]`` was taken at `stamp`; `first_index` is its index
    since the source started.
    """

    stamp: Stamp
    first_index: int
    counts: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class EyeEdge:
    """Edge of a photo-eye at `stamp`. `blocked` is the state of the eye after it."""

    stamp: Stamp
    eye: Eye
    blocked: bool


@dataclass(frozen=True, slots=True)
class Reference:
    """True mass of an item in kg; `stamp` is the t1 of the item.

    Raises
    ------
    ValueError
        If `mass` is negative, above MAX_MASS, or not a number.
    """

    stamp: Stamp
    mass: float

    def __post_init__(self) -> None:
        if not 0 <= self.mass <= MAX_MASS:
            raise ValueError(f'a reference mass of {self.mass:g} kg, must be 0..{MAX_MASS:g} kg')


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """Progress of the driver or of the segmenter in a stream.

    `stream` is the number that the driver gave to the stream, `stamp` the time of the last sample.
    The driver counts the `samples` and `edges` that it has sent. The segmenter counts those that it
    has processed, and the `items` that it has sent on; it has announced every item that the edges
    up to `last_edge` show. `text` is a message for the technician, empty without trouble.
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
    """Conditions of the machine since `stamp`, as its inputs show them.

    `conditions` are values of `StopReason`, and `inputs` names the input that shows each. If the
    inputs cannot be read, `known` is false, and every condition must be assumed.
    """

    stamp: Stamp
    known: bool
    conditions: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ExternalReject:
    """Rejection of an item by an inspection device.

    The item is `item_id` or, if that is 0, the item that was at the `device` at `stamp`.
    """

    stamp: Stamp | None
    device: str
    item_id: int = 0
    text: str = ''
