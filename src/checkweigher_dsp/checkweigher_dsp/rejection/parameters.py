# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the reject stage."""

from dataclasses import dataclass, fields
from functools import cached_property, partial
import math
from typing import Any, ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import NANOSECONDS, ProductOnLine
from checkweigher_dsp.rejection.stations import MAX_STATIONS, Station, station_of

_SLOWEST, _FASTEST = 1e-3, 100.0  # range of plausible belt speeds in m/s

_delay = partial(parameter, unit='s', minimum=0, maximum=10)
_length = partial(parameter, unit='m', minimum=0)
_mass = partial(parameter, unit='kg', minimum=0)
_speed = partial(parameter, unit='m/s', minimum=0)


@dataclass(frozen=True)
class RejectParameters(Parameters):
    """Parameters of the reject stage: limits without recipes, rejector, devices and stations."""

    node: ClassVar[str] = 'reject'

    lower_limit: float = parameter(
        -math.inf, 'LowerToleranceLimit: lighter is UNDER; -.inf for none', unit='kg'
    )
    upper_limit: float = parameter(
        math.inf, 'UpperToleranceLimit: heavier is OVER; .inf for none', unit='kg'
    )
    rejector_distance: float = _length(
        0.5, 'distance from the outfeed eye to the rejector', maximum=1000
    )
    actuator_delay: float = _delay(0.0, 'time from telling the rejector to its action')
    verdict_margin: float = _delay(
        0.05, 'time before its reject time at which an item has its verdict'
    )
    deadlines: bool = parameter(
        True, 'an item without a mass by then is NoEstimate; false waits for every mass'
    )
    confirmation_time: float = _delay(
        0.0, 'largest time between reject time and reject_eye; 0 without that eye', maximum=60
    )
    max_rejects_in_a_row: int = parameter(
        0, 'rejects in a row that raise a stop request; 0 for none', minimum=0, maximum=1_000_000
    )
    max_zero_step: float = _mass(
        0.02,
        'step of the zero from item to item, beyond which the line stops until it is zeroed; at '
        'most the tolerance of the product counts; 0: not checked',
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
    nominal: float = _mass(
        0.0, 'NominalWeight with tare, which batch_surplus of the verdicts counts from; 0 for none'
    )
    tu1: float = _mass(
        0.0, 'TU1 of 76/211/EEC with tare: lighter ones are accepted within tu1_quota; 0 for none'
    )
    tu1_quota: float = parameter(
        0.025,
        'largest share below tu1 of the accepted items of the batch, beyond it TU1Quota',
        minimum=0,
        maximum=1,
    )
    mean_value: bool = parameter(
        False,
        'an item below nominal is accepted only while the mean of the accepted ones of the batch '
        'stays at nominal or above, else MeanValueRequirement',
    )
    inspections: str = parameter(
        '', 'devices whose external_reject an item waits for, such as "metal xray vision"'
    )
    inspection_distances: tuple[float, ...] = _length(
        (),
        'distance of each of them behind the infeed eye, below 0 before it',
        minimum=-100,
        maximum=100,
    )
    inspection_times: tuple[float, ...] = _delay(
        (),
        'time after an item has passed it in which each answers, with the way of the message',
        maximum=60,
    )
    inspection_tolerance: float = _delay(
        0.02, 'by which the time of an answer may be off: two items that it fits are both rejected'
    )
    stations: str = parameter(
        '',
        'what each reject station or sorting zone beside the rejector takes, with ; between them: '
        'decisions, reasons, and of accepted items a range of masses in kg; such as '
        '"MetalDetected; UNDER; 0.150..0.155"',
    )
    station_distances: tuple[float, ...] = _length(
        (), 'distance of each of them behind the outfeed eye', maximum=1000
    )
    station_delays: tuple[float, ...] = _delay((), 'time from telling each of them to its action')
    needs_product: bool = parameter(
        False,
        'nothing is accepted (NoProduct) until there is a product; true on a line with recipes',
    )
    numbers: str = parameter(
        '',
        'file of the numbers of items with a verdict, beside that of segmenter; from the next '
        'start',
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
        _ = self.all_stations  # raises an exception if a station is not valid
        self._check_limits()

    def _check_limits(self) -> None:
        for name, none in (('lower_limit', -math.inf), ('upper_limit', math.inf)):
            value = getattr(self, name)
            if value != none and not 0 <= value < math.inf:
                raise ParameterError(
                    f'reject.{name}: {value} is not a mass in kg (or {none} for no limit)'
                )
        if self.mean_value and not self.nominal:
            raise ParameterError('reject.mean_value: true needs nominal, the weight in kg')
        for name in ('lower_limit', 'min_length', 'min_speed'):
            other = name.replace('lower', 'upper').replace('min', 'max')
            low, high = getattr(self, name), getattr(self, other)
            if low > high:
                raise ParameterError(f'reject.{name}: {low} is above {other} {high}')

    @cached_property
    def limits(self) -> ProductOnLine:
        """Limits of the items until the line has a product."""
        return ProductOnLine(0, needed=self.needs_product, **limits_of(self))

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

    @cached_property
    def all_stations(self) -> tuple[Station, ...]:
        """Reject stations in the order of their numbers."""
        places = zip(self._takes, self.station_distances, self.station_delays, strict=True)
        return tuple(
            station_of(text, distance, delay, f'reject.stations[{number}]')
            for number, (text, distance, delay) in enumerate(places)
        )

    def earliest_lead(self, speed: float) -> int:
        """Return the longest time in ns by which the signal to a station precedes the reject time.

        `speed` is the belt speed in m/s. The result is 0 if no signal precedes the reject time.
        """
        if not speed > 0:
            return 0
        leads = [
            (self.rejector_distance - distance) / speed + delay - self.actuator_delay
            for distance, delay in zip(self.station_distances, self.station_delays, strict=True)
        ]
        return round(NANOSECONDS * max((0.0, *leads)))

    def reject_time(self, t3: int | None, speed: float) -> int | None:
        """Return the reject time of an item in ns, which is the time of the signal to the rejector.

        The item reaches the outfeed eye at t3 in ns, and `speed` is the belt speed in m/s. The
        reject time is t3 + rejector_distance / speed - actuator_delay, or None if it is unknown.
        """
        if t3 is None or not _SLOWEST <= speed <= _FASTEST:
            return None
        way = round(NANOSECONDS * (self.rejector_distance / speed))
        return t3 + way - round(NANOSECONDS * self.actuator_delay)


# Names of the parameters that a product replaces.
LIMITS = tuple(
    entry.name for entry in fields(ProductOnLine) if entry.name in RejectParameters.entries()
)


def limits_of(source: RejectParameters | ProductOnLine) -> dict[str, Any]:
    """Return the limits of parameters or of a product, by name."""
    return {name: getattr(source, name) for name in LIMITS}
