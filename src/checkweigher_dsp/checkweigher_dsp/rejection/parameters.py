# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the reject stage: limits of the product, where the rejector stands."""

from dataclasses import Field, dataclass
from functools import partial
import math
from typing import Any, ClassVar

from checkweigher_dsp.parameters import ParameterError, Parameters, describe, parameter
from checkweigher_dsp.records import NANOSECONDS
from checkweigher_dsp.rejection.stations import MAX_STATIONS, Station, station_of
from checkweigher_dsp.segmentation.parameters import SegmenterParameters

# Segmenter and reject stage have to find the same items: these are in both of their sets.
SHARED_WITH_SEGMENTER = ('min_belt_speed', 'debounce_time', 'edge_lateness')

_SLOWEST, _FASTEST = 1e-3, 100.0  # m/s; other speeds are of no belt, and not known

_delay = partial(parameter, unit='s', minimum=0, maximum=10)
_length = partial(parameter, unit='m', minimum=0)
_speed = partial(parameter, unit='m/s', minimum=0)


def _shared(name: str) -> Any:
    """Return a field with default, unit and range of the segmenter's own."""
    entry: Field[Any] = SegmenterParameters.entries()[name]
    allowed = describe(entry)
    return parameter(
        entry.default, 'as that of segmenter; from the next start', unit=allowed.unit,
        minimum=allowed.minimum, maximum=allowed.maximum,
    )  # fmt: skip


@dataclass(frozen=True)
class RejectParameters(Parameters):
    """Limits of the product on the line, and where the rejector stands."""

    node: ClassVar[str] = 'reject'

    lower_limit: float = parameter(
        -math.inf, 'LowerToleranceLimit: lighter is UNDER; -.inf for none', unit='kg'
    )
    upper_limit: float = parameter(
        math.inf, 'UpperToleranceLimit: heavier is OVER; .inf for none', unit='kg'
    )
    rejector_distance: float = parameter(
        0.5, 'distance from the outfeed eye to the rejector', unit='m', minimum=0, maximum=1000
    )
    actuator_delay: float = _delay(0.0, 'time from telling the rejector to its action')
    verdict_margin: float = _delay(
        0.05, 'time before its reject time at which an item has its verdict'
    )
    deadlines: bool = parameter(
        True, 'an item without a mass by then is NoEstimate; false waits for every mass'
    )
    min_belt_speed: float = _shared('min_belt_speed')
    debounce_time: float = _shared('debounce_time')
    edge_lateness: float = _shared('edge_lateness')
    confirmation_time: float = _delay(
        0.0, 'largest time between reject time and reject_eye; 0 without that eye', maximum=60
    )
    max_rejects_in_a_row: int = parameter(
        0, 'rejects in a row that raise a stop request; 0 for none', minimum=0, maximum=1_000_000
    )
    autostart: bool = parameter(
        True, 'configure and activate at the start; false leaves that to a lifecycle manager'
    )
    min_length: float = _length(
        0.0, 'shortest product, a shorter one is ProductTooShort; 0 for any'
    )
    max_length: float = _length(
        math.inf, 'longest product, a longer one is ProductTooLong; .inf for any'
    )
    min_speed: float = _speed(
        0.0, 'slowest belt for the product, a slower one is BeltSpeed; 0 for any'
    )
    max_speed: float = _speed(
        math.inf, 'fastest belt for the product, a faster one is BeltSpeed; .inf for any'
    )
    nominal: float = parameter(
        0.0, 'NominalWeight with tare, which batch_surplus of the verdicts counts from; 0 for none',
        unit='kg', minimum=0,
    )  # fmt: skip
    tu1: float = parameter(
        0.0, 'TU1 of 76/211/EEC with tare: lighter ones are accepted within tu1_quota; 0 for none',
        unit='kg', minimum=0,
    )  # fmt: skip
    tu1_quota: float = parameter(
        0.025, 'largest share below tu1 of the accepted items of the batch, beyond it TU1Quota',
        minimum=0, maximum=1,
    )  # fmt: skip
    mean_value: bool = parameter(
        False, 'an item below nominal is accepted only while the mean of the accepted ones of the '
        'batch stays at nominal or above, else MeanValueRequirement',
    )  # fmt: skip
    product: str = parameter('', 'product of these limits; the node product sets it')
    batch: str = parameter('', 'batch whose items are counted; the node product sets it')
    batch_counts: tuple[float, ...] = parameter(
        (0.0, 0.0, 0.0, 0.0), 'counts with which the batch goes on: items, accepted, below TU1, '
        'surplus in kg; the node product sets them, later ones that reject has itself are kept',
    )  # fmt: skip
    inspections: str = parameter(
        '', 'devices whose external_reject an item waits for, such as "metal xray vision"'
    )
    inspection_distances: tuple[float, ...] = parameter(
        (), 'distance of each of them behind the infeed eye, below 0 before it', unit='m',
        minimum=-100, maximum=100,
    )  # fmt: skip
    inspection_times: tuple[float, ...] = parameter(
        (), 'time after an item has passed it in which each answers, with the way of the message',
        unit='s', minimum=0, maximum=60,
    )  # fmt: skip
    inspection_tolerance: float = _delay(
        0.02, 'by which the time of an answer may be off: two items that it fits are both rejected'
    )
    stations: str = parameter(
        '', 'what each reject station or sorting zone beside the rejector takes, with ; between '
        'them: decisions, reasons, and of accepted items a range of masses in kg; such as '
        '"MetalDetected; UNDER; 0.150..0.155"',
    )  # fmt: skip
    station_distances: tuple[float, ...] = parameter(
        (), 'distance of each of them behind the outfeed eye', unit='m', minimum=0, maximum=1000
    )
    station_delays: tuple[float, ...] = parameter(
        (), 'time from telling each of them to its action', unit='s', minimum=0, maximum=10
    )
    performance_test: bool = parameter(
        False, 'a performance test goes on: each item is rejected; the node product sets it'
    )
    needs_product: bool = parameter(
        False, 'nothing is accepted (NoProduct) while product is empty; true on a line with recipes'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        devices, takes = self.devices, self._takes
        self._check_lengths('inspections', devices, 'inspection_distances', 'inspection_times')
        self._check_lengths('stations', takes, 'station_distances', 'station_delays')
        if len(set(devices)) < len(devices):
            raise ParameterError(f'reject.inspections: {self.inspections!r} has a device twice')
        if len(takes) > MAX_STATIONS:
            raise ParameterError(f'reject.stations: {len(takes)}, at most {MAX_STATIONS}')
        self.all_stations()
        for name, none in (('lower_limit', -math.inf), ('upper_limit', math.inf)):
            value = getattr(self, name)
            if value != none and not (math.isfinite(value) and value >= 0):
                raise ParameterError(
                    f'reject.{name}: {value} is not a mass in kg (or {none} for no limit)'
                )
        if len(self.batch_counts) != 4 or not all(map(math.isfinite, self.batch_counts)):
            raise ParameterError(
                f'reject.batch_counts: {self.batch_counts} are not items, accepted, below TU1 and '
                'surplus'
            )
        if self.mean_value and not self.nominal:
            raise ParameterError('reject.mean_value: true needs nominal, the weight in kg')
        for low, high in (
            ('lower_limit', 'upper_limit'), ('min_length', 'max_length'), ('min_speed', 'max_speed')
        ):  # fmt: skip
            if getattr(self, low) > getattr(self, high):
                raise ParameterError(
                    f'reject.{low}: {getattr(self, low)} is above {high} {getattr(self, high)}'
                )
        if self.max_speed < self.min_belt_speed:
            raise ParameterError(
                f'reject.max_speed: {self.max_speed} is below min_belt_speed '
                f'{self.min_belt_speed}, slower than what is weighed at all'
            )

    def _check_lengths(self, first: str, found: tuple[str, ...], *others: str) -> None:
        for name in others:
            values = getattr(self, name)
            if len(values) != len(found):
                raise ParameterError(
                    f'reject.{name}: {len(values)} values, but {first} has {len(found)}'
                )

    @property
    def devices(self) -> tuple[str, ...]:
        """Names of the inspection devices."""
        return tuple(self.inspections.split())

    @property
    def _takes(self) -> tuple[str, ...]:
        return tuple(self.stations.split(';')) if self.stations.strip() else ()

    def all_stations(self) -> tuple[Station, ...]:
        """Return the stations beside the rejector, in their order."""
        places = zip(self._takes, self.station_distances, self.station_delays, strict=True)
        return tuple(
            station_of(text, distance, delay, f'reject.stations[{number}]')
            for number, (text, distance, delay) in enumerate(places)
        )

    def earliest_lead(self, speed: float) -> int:
        """Return by how much a station is to be told before the rejector at most, ns.

        At a belt speed in m/s; 0 if none is.
        """
        leads = [
            (self.rejector_distance - distance) / speed + delay - self.actuator_delay
            for distance, delay in zip(self.station_distances, self.station_delays, strict=True)
        ]
        return round(NANOSECONDS * max(0.0, *leads)) if leads and speed > 0 else 0

    def reject_time(self, t3: int | None, speed: float) -> int | None:
        """Return when the rejector has to be told for an item, ns; None if it is not known.

        t3 + rejector_distance / speed - actuator_delay, with t3 in ns and the speed in m/s: the
        leading edge is at the outfeed eye at t3.
        """
        if t3 is None or not _SLOWEST <= speed <= _FASTEST:
            return None
        way = round(NANOSECONDS * (self.rejector_distance / speed))
        return t3 + way - round(NANOSECONDS * self.actuator_delay)

    def max_transit(self, weigh_length: float) -> int:
        """Return how long an item takes over `weigh_length`, m, on the slowest belt, ns."""
        return round(NANOSECONDS * weigh_length / self.min_belt_speed)
