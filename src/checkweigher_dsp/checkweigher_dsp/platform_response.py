r"""What the weighing platform answers to a product that rides on, in closed form.

The platform is a second-order system whose mass changes with what rests on it. In kilograms of
static reading, with w the natural frequency and xi the damping ratio of the empty platform,

.. math:: \ddot y = s w^2 (f - y) - 2 s \xi w \dot y,   s = m_0 / (m_0 + m(t))

where m0 is the moving mass, m(t) the load on it and f(t) the force over g. As the product enters
the load grows linearly; its mass is taken as constant over short stairs, and within a stair the
response to a linear force is known in closed form. So the response is had at any sample, without
integration from one to the next.
"""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

# Of the crossing of an end of the belt. With 8 of them the mass is off by 1/16 of the product's at
# most and right on average.
_STAIRS = 8


@dataclass(frozen=True, slots=True)
class Platform:
    """A platform: `natural_frequency` in Hz, `damping_ratio` (below 1), `moving_mass` in kg."""

    natural_frequency: float
    damping_ratio: float
    moving_mass: float


@dataclass(frozen=True, slots=True)
class Crossing:
    """When the load of a product comes on and goes off, s; `off_begin` may be infinite."""

    on_begin: float
    on_end: float
    off_begin: float = math.inf
    off_end: float = math.inf


def responses(
    platform: Platform, mass: float, crossing: Crossing, time: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the responses that make up the signal of a pass.

    Parameters
    ----------
    platform : Platform
        The platform.
    mass : float
        kg, of the product: it moves with the platform.
    crossing : Crossing
        When its load comes on and goes off.
    time : ndarray, (n,) float64
        s, ascending; the first one is not after ``on_begin``.

    Returns
    -------
    ndarray, (5, n) float64
        Rows: response to the load of the product over its mass, 1 at rest; free oscillation that
        is 1 with no slope at ``time[0]``, and one that is 0 with the slope of the natural
        frequency; the same two from ``on_begin`` on, which together are what a short impact of
        any shape leaves.
    """
    omega = 2 * math.pi * platform.natural_frequency
    stairs = _stairs(crossing, float(time[0]))
    number = np.searchsorted([begin for begin, *_ in stairs], time, side='right') - 1
    # What each stretch begins with, a column for each: the decays, and the parts of the solution.
    rates = np.empty((2, len(stairs)))
    parts = np.empty((4, 5, len(stairs)))
    value = np.array([0.0, 1.0, 0.0, 0.0, 0.0])
    slope = np.array([0.0, 0.0, omega, 0.0, 0.0])
    forced, climbing = np.zeros(5), np.zeros(5)
    for column, (begin, end, load, rate, share) in enumerate(stairs):
        if begin == crossing.on_begin:
            value[3] += 1.0
            slope[4] += omega
        ease = platform.moving_mass / (platform.moving_mass + share * mass)
        decay = platform.damping_ratio * omega * ease
        squared = omega * omega * ease
        damped = math.sqrt(squared - decay * decay)
        # A force load + rate t has the particular solution load - lag + rate t.
        forced[0], climbing[0] = load - 2 * decay * rate / squared, rate
        cosine = value - forced
        sine = (slope - climbing + decay * cosine) / damped
        rates[:, column] = decay, damped
        parts[:, :, column] = cosine, sine, forced, climbing
        if math.isfinite(end):
            envelope = math.exp(-decay * (end - begin))
            c = envelope * math.cos(damped * (end - begin))
            s = envelope * math.sin(damped * (end - begin))
            free = c * cosine + s * sine
            value = free + forced + climbing * (end - begin)
            slope = damped * (c * sine - s * cosine) - decay * free + climbing
    since = time - np.array([begin for begin, *_ in stairs])[number]
    decays, dampeds = rates[:, number]
    envelopes = np.exp(-decays * since)
    cosines, sines, forces, climbs = parts[:, :, number]
    angles = dampeds * since
    result: NDArray[np.float64] = (
        cosines * (envelopes * np.cos(angles))
        + sines * (envelopes * np.sin(angles))
        + forces
        + climbs * since
    )
    return result


def _stairs(crossing: Crossing, start: float) -> list[tuple[float, float, float, float, float]]:
    """Return begin, end, load at the begin, its rate and the mean load of each stretch."""
    stairs = [(min(start, crossing.on_begin), crossing.on_begin, 0.0, 0.0, 0.0)]
    ends = [(crossing.on_begin, crossing.on_end, 0.0, 1.0)]
    if math.isfinite(crossing.off_begin):
        ends.append((crossing.off_begin, crossing.off_end, 1.0, -1.0))
    for number, (begin, end, load, change) in enumerate(ends):
        rate = change / (end - begin)
        bounds = np.linspace(begin, end, _STAIRS + 1)
        for position in range(_STAIRS):
            share = (position + 0.5) / _STAIRS
            stairs.append(
                (
                    float(bounds[position]), float(bounds[position + 1]),
                    load + change * position / _STAIRS, rate, share if change > 0 else 1 - share,
                )
            )  # fmt: skip
        rest = load + change
        until = ends[number + 1][0] if number + 1 < len(ends) else math.inf
        stairs.append((end, until, rest, 0.0, rest))
    return stairs
