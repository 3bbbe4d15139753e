# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the reject stage."""

from dataclasses import dataclass, fields
from functools import cached_property, partial
import math
from statistics import NormalDist
from typing import Any, ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import GRAMS, NANOSECONDS, ProductOnLine
from checkweigher_dsp.rejection.stations import MAX_STATIONS, Station, station_of

_SLOWEST, _FASTEST = 1e-3, 100.0  # range of plausible belt speeds in m/s

_delay = partial(parameter, unit='s', minimum=0, maximum=10)
_length = partial(parameter, unit='m', minimum=0)
_mass = partial(parameter, unit='kg', minimum=0)
_speed = partial(parameter, unit='m/s', minimum=0)


@dataclass(frozen=True)
class RejectParameters(Parameters):
    """Parameters of the reject stage: limits without a product, rejector, devices, stations.

    Raises
    ------
    ParameterError
        If a value is not allowed, if lists that belong together differ in length, if a device is
        named twice, if there are too many stations or one is not valid, if a lower limit is above
        its upper limit, or if ``mean_value`` is True without a nominal weight.
    """

    node: ClassVar[str] = 'reject'

    lower_limit: float = parameter(
        -math.inf, 'lower tolerance limit; a lighter item is UNDER; -.inf: no limit', unit='kg'
    )
    upper_limit: float = parameter(
        math.inf, 'upper tolerance limit; a heavier item is OVER; .inf: no limit', unit='kg'
    )
    rejector_distance: float = _length(
        0.5, 'distance from the outfeed eye to the rejector', maximum=1000
    )
    actuator_delay: float = _delay(0.0, 'time from the signal to the rejector until it acts')
    verdict_margin: float = _delay(
        0.05, 'shortest time between a verdict and the reject time of its item'
    )
    deadlines: bool = parameter(
        True,
        'whether an item whose mass does not arrive in time is a FAULT (NoEstimate); false: the '
        'verdict waits for the mass without a limit',
    )
    confirmation_time: float = _delay(
        0.0,
        'largest time between the reject time of an item and the edge of reject_eye that confirms '
        'its reject; 0: there is no such eye',
        maximum=60,
    )
    max_rejects_in_a_row: int = parameter(
        0,
        'number of successive rejects that stops the line; 0: no limit',
        minimum=0,
        maximum=1_000_000,
    )
    max_zero_step: float = _mass(
        0.02,
        'largest sudden change of the zero between two items; a larger one stops the line until '
        'the zero is set; the tolerance of the product applies instead if it is smaller; 0: not '
        'checked',
    )
    autostart: bool = parameter(
        True,
        'whether the node activates itself at its start; false: a lifecycle manager activates it',
    )
    min_length: float = _length(
        0.0,
        'smallest length of a product; a shorter item is a FAULT (ProductTooShort); 0: no limit',
    )
    max_length: float = _length(
        math.inf,
        'largest length of a product; a longer item is a FAULT (ProductTooLong); .inf: no limit',
    )
    min_speed: float = _speed(
        0.0,
        'lowest belt speed for the product; an item at a lower speed is a FAULT (BeltSpeed); 0: no '
        'limit',
    )
    max_speed: float = _speed(
        math.inf,
        'highest belt speed for the product; an item at a higher speed is a FAULT (BeltSpeed); '
        '.inf: no limit',
    )
    nominal: float = _mass(
        0.0, 'nominal weight plus tare, the reference of batch_surplus in verdicts; 0: none'
    )
    tu1: float = _mass(
        0.0,
        'tolerance limit TU1 of 76/211/EEC plus tare; tu1_quota limits the share of lighter items; '
        '0: none',
    )
    tu1_quota: float = parameter(
        0.025,
        'largest share of items below tu1 among the accepted items of a batch; an item that would '
        'exceed it is UNDER (TU1Quota)',
        minimum=0,
        maximum=1,
    )
    mean_value: bool = parameter(
        False,
        'whether an item below nominal is accepted only if the mean of the accepted items of the '
        'batch stays at or above nominal; otherwise the item is UNDER (MeanValueRequirement)',
    )
    guard_risk: float = parameter(
        0.0,
        'largest probability with which an item outside the limits is accepted (JCGM 106); each '
        'limit is moved inwards by a multiple of the standard deviation of the mass; an item that '
        'is rejected only therefore has the reason GuardBand; 0: the limits are not moved',
        minimum=0,
        maximum=0.5,
    )
    inspections: str = parameter(
        '',
        'names of the inspection devices for whose answers a verdict waits, separated by spaces, '
        'such as "metal xray vision"',
    )
    inspection_distances: tuple[float, ...] = _length(
        (),
        'distance of each inspection device behind the infeed eye; negative: before it',
        minimum=-100,
        maximum=100,
    )
    inspection_times: tuple[float, ...] = _delay(
        (),
        'longest time from the passage of an item at each device until its answer arrives',
        maximum=60,
    )
    inspection_tolerance: float = _delay(
        0.02,
        'largest error of the time stamp of an answer; an answer that fits two items rejects both',
    )
    stations: str = parameter(
        '',
        'items that each additional reject station or sorting zone removes, separated by '
        'semicolons: decisions, reasons, or a range of accepted masses in kg, such as '
        '"MetalDetected; UNDER; 0.150..0.155"',
    )
    station_distances: tuple[float, ...] = _length(
        (), 'distance of each station behind the outfeed eye', maximum=1000
    )
    station_delays: tuple[float, ...] = _delay(
        (), 'time from the signal to each station until it acts'
    )
    needs_product: bool = parameter(
        False,
        'whether items are a FAULT (NoProduct) until a product is selected; true with recipes',
    )
    numbers: str = parameter(
        '',
        'file that keeps the numbers of items with a verdict for the next start of the line; '
        'empty: the next start has no such numbers',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        devices, takes = self.devices, self._takes
        self._check_lengths('inspections', devices, 'inspection_distances', 'inspection_times')
        self._check_lengths('stations', takes, 'station_distances', 'station_delays')
        if len(set(devices)) < len(devices):
            raise ParameterError(f'reject.inspections: {self.inspections!r} names a device twice')
        if len(takes) > MAX_STATIONS:
            raise ParameterError(
                f'reject.stations: {len(takes)} stations, but at most {MAX_STATIONS} are possible'
            )
        # Compute the stations now, to raise an exception if a description is not valid.
        _ = self.all_stations
        self._check_limits()

    def _check_limits(self) -> None:
        for name, none in (('lower_limit', -math.inf), ('upper_limit', math.inf)):
            value = getattr(self, name)
            if value != none and not 0 <= value < math.inf:
                raise ParameterError(
                    f'reject.{name}: {value} is not a mass in kg (or {none} for no limit)'
                )
        if self.mean_value and not self.nominal:
            raise ParameterError(
                'reject.mean_value: true requires reject.nominal, the nominal weight in kg'
            )
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

    @cached_property
    def guard_factor(self) -> float:
        """Width of the guard band at each limit, in standard deviations of the mass."""
        return NormalDist().inv_cdf(1 - self.guard_risk) if self.guard_risk else 0.0

    @property
    def devices(self) -> tuple[str, ...]:
        """Names of the inspection devices."""
        return tuple(self.inspections.split())

    @property
    def _takes(self) -> tuple[str, ...]:
        return tuple(self.stations.split(';')) if self.stations.strip() else ()

    @cached_property
    def all_stations(self) -> tuple[Station, ...]:
        """Stations, in the order of the parameter `stations`.

        Raises `ParameterError` if the description of a station is not valid.
        """
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
        reject time is t3 + rejector_distance / speed - actuator_delay. The result is None if t3 is
        None, or if the speed is NaN or not between 0.001 and 100 m/s.
        """
        if t3 is None or not _SLOWEST <= speed <= _FASTEST:
            return None
        way = round(NANOSECONDS * (self.rejector_distance / speed))
        return t3 + way - round(NANOSECONDS * self.actuator_delay)


# Names of the parameters that a product replaces.
LIMITS = tuple(
    entry.name for entry in fields(ProductOnLine) if entry.name in RejectParameters.entries()
)


def limit_text(limit: float) -> str:
    """Return a limit in kg as a text in g, or 'none' if it is infinite."""
    return f'{GRAMS * limit:g} g' if math.isfinite(limit) else 'none'


def limits_of(source: RejectParameters | ProductOnLine) -> dict[str, Any]:
    """Return the limits of parameters or of a product, by name."""
    return {name: getattr(source, name) for name in LIMITS}
