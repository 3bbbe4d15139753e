# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Response of the weighing platform to a product that crosses it, in closed form.

The platform is a second-order system whose mass changes with the load. With w the angular natural
frequency and xi the damping ratio of the empty platform, the reading y in kg obeys

.. math:: \ddot y = s w^2 (f - y) - 2 s \xi w \dot y,   s = m_0 / (m_0 + m(t))

where m0 is the moving mass, m(t) the load and f(t) the force divided by g. The load increases
linearly while the product enters. The moving mass is approximated by steps, because the response to
a linear force has a closed form while the mass is constant (own derivation). So the response is
computed without numerical integration.
"""

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from checkweigher_dsp.signal import Array

# Number of steps of the moving mass while a product enters, and while it leaves. With 8 steps, the
# error of the moving mass is at most 1/16 of the mass of the product, and 0 on average.
_STAIRS = 8


@dataclass(frozen=True, slots=True)
class Platform:
    """Parameters of the weighing platform without load."""

    natural_frequency: float  # natural frequency in Hz
    damping_ratio: float  # damping ratio, below 1
    moving_mass: float  # moving mass in kg


@dataclass(frozen=True, slots=True)
class Crossing:
    """Times in s at which the rise and the fall of the load of a product begin and end.

    The times of the fall are infinite if the product does not leave.
    """

    on_begin: float
    on_end: float
    off_begin: float = math.inf
    off_end: float = math.inf


def responses(platform: Platform, mass: float, crossing: Crossing, time: Array) -> Array:
    """Return five responses, (5, n), whose linear combination is the signal of a pass.

    `mass` is the mass of the product in kg. `time`, (n,) in s, ascends and begins no later than
    ``on_end``. The first row is the response to the load of the product, divided by its mass. Rows
    2 to 5 are free oscillations. Rows 2 and 3 begin at ``time[0]``. Row 2 begins with value 1 and
    slope 0, and row 3 with value 0 and a slope equal to the angular natural frequency. The initial
    values of rows 2 and 3 are approximate if ``time[0]`` is after ``on_begin``, because the loaded
    platform oscillates more slowly. Rows 4 and 5 begin in the same way at ``on_begin``, and
    describe the oscillation after a short impact at entry.

    Examples
    --------
    >>> time = np.array([-0.01, 0.05, 0.1, 1.0])
    >>> platform = Platform(natural_frequency=38.0, damping_ratio=0.06, moving_mass=2.5)
    >>> load = responses(platform, 0.2, Crossing(on_begin=0.0, on_end=0.1), time)[0]
    >>> load.round(2).tolist()
    [0.0, 0.51, 1.01, 1.0]
    """
    omega = 2 * math.pi * platform.natural_frequency
    decay = platform.damping_ratio * omega
    damped = math.sqrt(omega * omega - decay * decay)
    result = np.zeros((5, len(time)))
    entry = int(np.searchsorted(time, crossing.on_begin))
    start = float(time[0])
    result[1:3, :entry] = _oscillations(time[:entry] - start, omega, decay, damped)
    # After the entry, rows 2 and 3 are combinations of rows 4 and 5. The coefficients are the
    # values and slopes (divided by omega) of rows 2 and 3 at the entry.
    one, other = _oscillations(crossing.on_begin - start, omega, decay, damped)
    slopes = -other, one - 2 * platform.damping_ratio * other
    stairs = np.array(_stairs(platform, mass, crossing)).T
    number = np.searchsorted(stairs[0], time[entry:], side='right') - 1
    begin, decays, dampeds, forces, rates, *waves = stairs[:, number]
    since = time[entry:] - begin
    envelopes = np.exp(-decays * since)
    angles = dampeds * since
    cosines, sines = envelopes * np.cos(angles), envelopes * np.sin(angles)
    loaded, free, kicked = (waves[k] * cosines + waves[k + 1] * sines for k in (0, 2, 4))
    result[:, entry:] = (
        loaded + forces + rates * since,
        one * free + slopes[0] * kicked,
        other * free + slopes[1] * kicked,
        free,
        kicked,
    )
    return result


def _oscillations(since: Any, omega: float, decay: float, damped: float) -> tuple[Any, Any]:
    """Return two free oscillations of the empty platform at the times `since` in s.

    At time 0, the first oscillation has the value 1 and the slope 0, and the second the value 0 and
    the slope `omega`. `omega` is the angular natural frequency, `decay` the decay rate and `damped`
    the damped angular frequency, all in 1/s.
    """
    envelope = np.exp(-decay * since)
    cosine, sine = envelope * np.cos(damped * since), envelope * np.sin(damped * since)
    return cosine + decay / damped * sine, omega / damped * sine


def _stairs(platform: Platform, mass: float, crossing: Crossing) -> list[tuple[float, ...]]:
    """Return the solution on each segment of constant moving mass after the entry begins.

    A solution contains the beginning of the segment in s, its decay rate and its damped angular
    frequency, and the constant and the rate of the forced response. A solution also contains the
    cosine and sine coefficients of three responses: the response to the load, and the free
    oscillations that begin at the entry with value 1 and with slope omega.
    """
    omega = 2 * math.pi * platform.natural_frequency
    value, slope, free, free_slope, kicked, kicked_slope = 0.0, 0.0, 1.0, 0.0, 0.0, omega
    solution: list[tuple[float, ...]] = []
    for begin, length, load, rate, share in _segments(crossing):
        ease = platform.moving_mass / (platform.moving_mass + share * mass)
        decay = platform.damping_ratio * omega * ease
        squared = omega * omega * ease
        damped = math.sqrt(squared - decay * decay)
        # The particular solution for the force `load + rate * t` is `forced + rate * t`.
        forced = load - 2 * decay * rate / squared
        c0 = value - forced
        s0 = (slope - rate + decay * c0) / damped
        c3, s3 = free, (free_slope + decay * free) / damped
        c4, s4 = kicked, (kicked_slope + decay * kicked) / damped
        solution.append((begin, decay, damped, forced, rate, c0, s0, c3, s3, c4, s4))
        if length == math.inf:
            break
        envelope = math.exp(-decay * length)
        c, s = envelope * math.cos(damped * length), envelope * math.sin(damped * length)
        bare, free, kicked = c * c0 + s * s0, c * c3 + s * s3, c * c4 + s * s4
        value = bare + forced + rate * length
        slope = damped * (c * s0 - s * c0) - decay * bare + rate
        free_slope = damped * (c * s3 - s * c3) - decay * free
        kicked_slope = damped * (c * s4 - s * c4) - decay * kicked
    return solution


def _segments(crossing: Crossing) -> list[tuple[float, float, float, float, float]]:
    """Return the beginning, duration, initial load, load rate and mean load of each segment.

    Times are in s, and loads are fractions of the mass of the product.
    """
    segments = []
    ends = [(crossing.on_begin, crossing.on_end, 0.0, 1.0)]
    if math.isfinite(crossing.off_begin):
        ends.append((crossing.off_begin, crossing.off_end, 1.0, -1.0))
    untils = crossing.off_begin, math.inf
    for (begin, end, load, change), until in zip(ends, untils, strict=False):
        rate, stair = change / (end - begin), (end - begin) / _STAIRS
        segments += [
            (
                begin + position * stair,
                stair,
                load + change * position / _STAIRS,
                rate,
                load + change * (position + 0.5) / _STAIRS,
            )
            for position in range(_STAIRS)
        ]
        segments.append((end, until - end, load + change, 0.0, load + change))
    return segments
