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
# Duration in s of the reading of an empty belt by which the service `zero` sets the zero, at most
# `_ZEROING_RATIO` times ``zero_time``. With 5 s, the standard deviation of the zero is less than
# half of that with 1 s.
_ZEROING, _ZEROING_RATIO = 5.0, 5

_duration = partial(parameter, unit='s', minimum=0, maximum=60)
_mass = partial(parameter, unit='kg', minimum=0, maximum=1e6)
_length = partial(parameter, unit='m', minimum=0, maximum=100)
_speed = partial(parameter, unit='m/s', minimum=1e-3, maximum=100)


@dataclass(frozen=True)
class SegmenterParameters(Parameters):
    """Parameters of the segmenter: windows, zero, item tracking, and checks.

    Raises `ParameterError` if a value is not allowed, or if ``min_belt_speed`` is not below
    ``max_belt_speed``.
    """

    node: ClassVar[str] = 'segmenter'

    lead_time: float = _duration(0.5, 'duration of the signal before t1 in each window')
    trail_time: float = _duration(
        0.0,
        'duration of the signal after t3 in each window, at most until the item has left; it '
        'delays the verdict, and only gauss_markov uses it',
    )
    zero_time: float = _duration(
        1.0,
        'longest duration of the empty-belt signal before t1 from which the zero is computed; the '
        'service zero reads a belt that stays empty five times as long, at most 5 s',
    )
    settle_time: float = _duration(
        0.1,
        'time after an item has left in which the signal is not used for the zero, because the '
        'platform rings down',
    )
    zero_initial_std_dev: float = _mass(
        0.005, 'standard deviation of the change of the zero since the calibration', minimum=1e-9
    )
    zero_random_walk: float = _mass(
        1e-5,
        'standard deviation of the random walk of the zero; with a larger value the zero follows '
        'faster and averages less',
        unit='kg/sqrt(s)',
    )
    zero_drift: float = _mass(
        2e-5,
        'standard deviation of the steady drift of the zero; 0: the drift is not estimated',
        unit='kg/s',
    )
    zero_moment: float = _duration(
        0.03,
        'shortest duration of the empty-belt signal for the zero; it includes the ring-down if the '
        'signal after the ring-down is shorter',
    )
    zero_range: float = _mass(
        0.3, 'largest change of the zero since the calibration; OIML R 51 allows 4 % of Max'
    )
    zero_rate: float = _mass(
        1.0, 'highest rate of zero tracking; OIML R 51 allows 0.5 e per second', unit='kg/s'
    )
    zero_stability: float = _mass(
        0.1,
        'largest difference between the means of parts of 0.1 s of the empty belt; above it, the '
        'zero is not updated',
    )
    max_belt_noise: float = _mass(
        0.0,
        'standard deviation of the empty-belt signal above which the diagnostics warn; 0: no limit',
    )
    min_belt_speed: float = _speed(
        0.1, 'lowest belt speed; an item that takes longer is a FAULT (MissingEdge)'
    )
    max_belt_speed: float = _speed(3.0, 'highest belt speed')
    min_product_length: float = _length(
        0.005, 'smallest length of a product; a shorter one is a FAULT'
    )
    product_length: float = _length(0.0, 'length of the products; 0: unknown, not checked')
    product_width: float = _length(
        0.0, 'width of the products, by which an askew product is recognised; 0: unknown'
    )
    length_tolerance: float = _length(
        0.01, 'largest difference between the length that the eyes measure and product_length'
    )
    speed_tolerance: float = parameter(
        0.2,
        'largest relative change of the belt speed between two items; 0: not checked',
        minimum=0,
        maximum=100,
    )
    debounce_time: float = _duration(
        0.005,
        'shortest time for which an eye is clear between two items; less is chatter',
        maximum=10,
    )
    edge_lateness: float = _duration(
        2.0, 'longest time by which an edge may arrive after the samples of its time'
    )
    sample_lateness: float = _duration(
        10.0,
        'longest time by which samples may arrive after the edges of their time',
        minimum=0.1,
        maximum=600,
    )
    clock_tolerance: float = _duration(
        0.02,
        'largest difference between the stamp of a block and the time computed from its index; '
        'above it, the items on the belt are a FAULT (ClockJump)',
        minimum=1e-6,
    )
    rise_lag: float = parameter(
        PLATFORM_LAG,
        'delay of the load in the samples relative to the eyes, due to the filter of the '
        'amplifier, the clocks, and the platform (2 xi / omega)',
        unit='s',
        minimum=-1,
        maximum=1,
    )
    rise_lag_distance: float = parameter(
        0.0,
        'distance that is divided by the belt speed and added to rise_lag; a misplaced infeed eye '
        'causes it',
        unit='m',
        minimum=-1,
        maximum=1,
    )
    rise_lag_known: bool = parameter(
        False,
        'whether rise_lag and rise_lag_distance were measured with such products; false: the lag '
        'is learned from the first items',
    )
    rise_lag_tolerance: float = _duration(
        0.003,
        'largest change of the delay, in addition to 2 % of t2 - t1; beyond it, an item is a FAULT '
        '(EdgeMismatch); 0: not checked',
        maximum=1,
    )
    min_window: int = parameter(
        16,
        'smallest number of samples between t2 and t3',
        unit='samples',
        minimum=8,
        maximum=1_000_000,
    )

    numbers: str = parameter(
        '', 'file that stores the item numbers, which continue in the next run; empty: begin at 1'
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_belt_speed >= self.max_belt_speed:
            raise ParameterError(
                f'segmenter.min_belt_speed: {self.min_belt_speed:g} is not below max_belt_speed '
                f'{self.max_belt_speed:g} m/s'
            )

    def check_lengths(self, load_cell: LoadCell) -> None:
        """Raise `ParameterError` if the windows or the buffer would need too many samples."""
        transit = seconds(self.max_transit(load_cell.weigh_length))
        window = {
            'min_belt_speed': transit,
            'lead_time': self.lead_time,
            'trail_time': min(self.trail_time, transit),
        }
        rest = {'zero_time': self.zeroing_time, 'edge_lateness': 2 * self.edge_lateness}
        for spans, most in ((window, MAX_WINDOW), (window | rest, _MAX_HISTORY)):
            samples = load_cell.sample_rate * sum(spans.values())
            if samples > most:
                name = max(spans, key=lambda each: spans[each])
                raise ParameterError(
                    f'segmenter.{name}: {getattr(self, name):g} needs {samples:.0f} samples at '
                    f'{load_cell.sample_rate:g} Hz on {load_cell.weigh_length:g} m of belt, above '
                    f'{most}: {"raise" if name == "min_belt_speed" else "lower"} it'
                )

    @property
    def zeroing_time(self) -> float:
        """Duration in s of the reading of an empty belt by the service `zero`."""
        return max(self.zero_time, min(_ZEROING, _ZEROING_RATIO * self.zero_time))

    def max_transit(self, weigh_length: float) -> int:
        """Return the longest transit of an item in ns; `weigh_length` is in m."""
        return round(NANOSECONDS * weigh_length / self.min_belt_speed)
