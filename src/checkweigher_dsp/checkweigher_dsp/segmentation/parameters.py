# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the segmenter."""

from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import MAX_WINDOW, NANOSECONDS, LoadCell, seconds
from checkweigher_dsp.signal.rise_lag import PLATFORM_LAG

_MAX_HISTORY = 2**22  # maximum number of samples in the buffer

_duration = partial(parameter, unit='s', minimum=0, maximum=60)
_mass = partial(parameter, unit='kg', minimum=0, maximum=1e6)
_length = partial(parameter, unit='m', minimum=0, maximum=100)
_speed = partial(parameter, unit='m/s', minimum=1e-3, maximum=100)


@dataclass(frozen=True)
class SegmenterParameters(Parameters):
    """Parameters of the segmenter, for the tracking of items, the checks, and the zero."""

    node: ClassVar[str] = 'segmenter'

    lead_time: float = _duration(0.5, 'signal before t1 that goes with each window')
    trail_time: float = _duration(
        0.0,
        'signal after t3 that is waited for, at most until the item has left; later verdicts, '
        'only gauss_markov gains',
    )
    zero_time: float = _duration(1.0, 'empty belt before t1 that is read for the zero, at most')
    settle_time: float = _duration(
        0.1, 'ring-down after an item has left, not read for the zero; longer on a soft platform'
    )
    zero_initial_std_dev: float = _mass(
        0.005, 'drift of the zero since calibration, standard deviation', minimum=1e-9
    )
    zero_random_walk: float = _mass(
        1e-5,
        'what the zero moves at random in a second, standard deviation; larger follows '
        'faster, averages less',
        unit='kg/sqrt(s)',
    )
    zero_drift: float = _mass(
        2e-5,
        'drift of the zero, standard deviation; it is looked for unless this is 0',
        unit='kg/s',
    )
    zero_moment: float = _duration(
        0.03, 'shortest empty belt that is read; where less has settled, the ring-down as well'
    )
    zero_range: float = _mass(
        0.3, 'largest distance from the zero of calibration; 4 % of Max in OIML R 51'
    )
    zero_rate: float = _mass(
        1.0, 'fastest tracking of the zero; 0.5 e a second, OIML R 51', unit='kg/s'
    )
    zero_stability: float = _mass(0.1, 'an empty belt is not read if parts of 0.1 s differ by more')
    max_belt_noise: float = _mass(
        0.0, 'standard deviation of the empty belt above which the diagnostics warn; 0: none'
    )
    min_belt_speed: float = _speed(0.1, 'slowest belt; an item that takes longer is given up')
    max_belt_speed: float = _speed(3.0, 'fastest belt')
    min_product_length: float = _length(0.005, 'shortest product; a shorter one is a fault')
    product_length: float = _length(0.0, 'length of the products; 0: not known, not checked')
    product_width: float = _length(
        0.0, 'width of the products, to tell one that lies askew; 0: not known'
    )
    length_tolerance: float = _length(
        0.01, 'largest difference between the length from the eyes and product_length'
    )
    speed_tolerance: float = parameter(
        0.2,
        'largest relative change of belt speed from item to item; 0: not checked',
        minimum=0,
        maximum=100,
    )
    debounce_time: float = _duration(
        0.005, 'shortest time for which an eye clears; less is chatter', maximum=10
    )
    edge_lateness: float = _duration(
        2.0, 'largest delay of edges behind the samples of the same time'
    )
    sample_lateness: float = _duration(
        10.0, 'largest delay of samples behind the edges of the same time', minimum=0.1, maximum=600
    )
    clock_tolerance: float = _duration(
        0.02,
        'largest difference between the stamp of a block and the time of its index',
        minimum=1e-6,
    )
    rise_lag: float = parameter(
        PLATFORM_LAG,
        'how much later than the eyes say samples show a load: filter of the '
        'amplifier, clocks, and 2 xi / omega of the platform',
        unit='s',
        minimum=-1,
        maximum=1,
    )
    rise_lag_distance: float = parameter(
        0.0,
        'the part of it that goes with 1 / belt speed: an infeed eye that sees too early',
        unit='m',
        minimum=-1,
        maximum=1,
    )
    rise_lag_known: bool = parameter(
        False, 'whether both were measured with products like these; else the first items tell'
    )
    rise_lag_tolerance: float = _duration(
        0.003,
        'largest change of the lag, beside 2 % of t2 - t1: EdgeMismatch; 0: not checked',
        maximum=1,
    )
    min_window: int = parameter(
        16,
        'fewest samples between t2 and t3 that can be weighed',
        unit='samples',
        minimum=8,
        maximum=1_000_000,
    )

    numbers: str = parameter(
        '', 'file of the numbers of items, which go on over runs; empty: each run counts from 1'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_belt_speed >= self.max_belt_speed:
            raise ParameterError(
                f'segmenter.min_belt_speed: {self.min_belt_speed:g} is not below max_belt_speed '
                f'{self.max_belt_speed:g} m/s'
            )

    def check_lengths(self, load_cell: LoadCell) -> None:
        """Check that the windows and the buffer are not too long for a load cell.

        Raises
        ------
        ParameterError
            If they need too many samples at the sample rate of the load cell.
        """
        transit = seconds(self.max_transit(load_cell.weigh_length))
        window = {
            'min_belt_speed': transit,
            'lead_time': self.lead_time,
            'trail_time': min(self.trail_time, transit),
        }
        rest = {'zero_time': self.zero_time, 'edge_lateness': 2 * self.edge_lateness}
        for spans, most in ((window, MAX_WINDOW), (window | rest, _MAX_HISTORY)):
            samples = load_cell.sample_rate * sum(spans.values())
            if samples > most:
                name = max(spans, key=lambda each: spans[each])
                raise ParameterError(
                    f'segmenter.{name}: {getattr(self, name):g} asks for {samples:.0f} samples at '
                    f'{load_cell.sample_rate:g} Hz on {load_cell.weigh_length:g} m of belt, at '
                    f'most {most}: {"raise" if name == "min_belt_speed" else "lower"} it'
                )

    def max_transit(self, weigh_length: float) -> int:
        """Return the longest transit of an item in ns; `weigh_length` is in m."""
        return round(NANOSECONDS * weigh_length / self.min_belt_speed)
