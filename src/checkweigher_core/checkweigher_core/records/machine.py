# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Records of the load cell, the photo-eyes, the machine inputs and the inspection devices."""

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records.newer import newer
from checkweigher_core.records.quantities import MAX_MASS, MAX_SAMPLE_RATE, Stamp


class Eye(IntEnum):
    """Photo-eye at one of the two ends of the weigh belt."""

    INFEED = 0
    OUTFEED = 1


class StreamState(IntEnum):
    """State of a stream of samples: FAILED if its source failed, FINISHED after any other end."""

    RUNNING = 0
    FINISHED = 1
    FAILED = 2


@dataclass(frozen=True, slots=True)
class LoadCell:
    """Load cell, with the calibration that converts its readings to kg.

    Raises ValueError with the name of the field if a value is outside its valid range.
    """

    sample_rate: float  # sample rate in Hz
    counts_per_kg: float  # sensitivity in counts/kg; negative if the cell is mounted upside down
    zero_counts: float  # reading of the empty belt at calibration, in counts
    min_counts: int  # lower limit of the converter in counts; a reading at or below it is saturated
    max_counts: int  # upper limit of the converter in counts; a reading at or above it is saturated
    capacity: float  # largest load on the belt in kg, without the weight of the belt
    weigh_length: float  # distance from the infeed eye to the outfeed eye in m
    model: str = ''  # empty if unknown
    serial_number: str = ''  # empty if unknown

    def __post_init__(self) -> None:
        for name, (least, most, unit) in _POSSIBLE.items():
            value = getattr(self, name)
            magnitude = abs(value) if name == 'counts_per_kg' else value
            span = f'{least:g}..{most:g} {unit}'
            _require(least <= magnitude <= most, f'{name} is {value:g}, but must be within {span}')
        lower, upper, zero = self.min_counts, self.max_counts, self.zero_counts
        _require(lower < upper, f'min_counts {lower} is not below max_counts {upper}')
        span = f'min_counts..max_counts, {lower}..{upper}'
        _require(lower <= zero <= upper, f'zero_counts is {zero:g}, but must be within {span}')

    @classmethod
    def of(cls, parameters: object, **others: Any) -> 'LoadCell':
        """Return a load cell whose fields are the attributes of `parameters` with the same names.

        The keyword arguments `others` override the attributes of `parameters`.
        """
        names = [entry.name for entry in fields(cls) if hasattr(parameters, entry.name)]
        return cls(**{name: getattr(parameters, name) for name in names} | others)


# Minimum, maximum and unit of each field with a fixed range. The range of counts_per_kg applies to
# its absolute value.
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
    """Consecutive readings of the load cell.

    `counts` contains the readings of the converter, shape (n,). The reading ``counts[0]`` was taken
    at time `stamp`, and has the index `first_index` in the stream.
    """

    stamp: Stamp
    first_index: int
    counts: NDArray[np.int32]


@dataclass(frozen=True, slots=True)
class EyeEdge:
    """Edge of a photo-eye at time `stamp`.

    `blocked` is true if the eye is blocked after the edge.
    """

    stamp: Stamp
    eye: Eye
    blocked: bool


@dataclass(frozen=True, slots=True)
class Reference:
    """Known mass of an item in kg. `stamp` is t1, the time at which the item begins to enter.

    Raises
    ------
    ValueError
        If `mass` is negative, NaN or above `MAX_MASS`.
    """

    stamp: Stamp
    mass: float

    def __post_init__(self) -> None:
        if not 0 <= self.mass <= MAX_MASS:
            raise ValueError(f'reference mass is {self.mass:g} kg, but must be 0..{MAX_MASS:g} kg')


@dataclass(frozen=True, slots=True)
class StreamStatus:
    """Progress of the driver or of the segmenter in a stream of samples.

    `stream` is the number that the driver has given to the stream, and `stamp` is the stamp of the
    latest block, or 0 before the first block. The driver counts the `samples` and `edges` that it
    has sent in this stream. The segmenter counts the samples and edges that it has processed.
    `items` is the number of windows that the segmenter has sent in all streams since its start, and
    is 0 in a status of the driver. `last_edge` is the stamp of the latest edge that the segmenter
    has assigned to an item. `last_edge` is None before the first assignment of an edge, and in a
    status of the driver. `text` is a message of the driver on a fault or on its deactivation;
    otherwise it is empty.
    """

    stamp: Stamp
    stream: int
    state: StreamState
    samples: int = 0
    edges: int = 0
    items: int = 0
    text: str = ''
    last_edge: Stamp | None = newer(None)


@dataclass(frozen=True, slots=True)
class MachineConditions:
    """Conditions that require a stop of the line, as shown by the machine inputs since `stamp`.

    `conditions` contains values of `StopReason`, one for each input that shows a condition.
    `inputs` contains the name of the input for each of the `conditions`. If the inputs cannot be
    read, `known` is false, and the receiver must stop the line.
    """

    stamp: Stamp
    known: bool
    conditions: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ExternalReject:
    """Rejection of an item by an inspection device.

    `device` is the name of the device, such as ``metal``, ``xray`` or ``vision``. If `item_id` is
    0, the rejected item is the item that was at the device at time `stamp`. If `item_id` is not 0,
    `stamp` may be None. `text` contains details of the finding, or is empty.
    """

    stamp: Stamp | None
    device: str
    item_id: int = 0
    text: str = ''
