# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Family of belt scales with random properties. The profile ``machine:SEED`` selects one scale.

A random machine has more causes of disturbance than a `Profile`. Each cause of disturbance is a
field of `Machine`, and `Machine.without` removes causes. The ranges of the properties are typical
of belt scales for products of up to a few kilograms; they are not fitted to a particular machine.
Forces are divided by the gravitational acceleration g, so they are in kg.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, Self, TypeVar

import numpy as np

from checkweigher_dsp.signal.platform_response import Platform

PREFIX = 'machine:'
_Cause = TypeVar('_Cause')


class _Draw:
    """Source of random numbers for the fields of `Machine`."""

    def __init__(self, seed: np.random.SeedSequence) -> None:
        self._random = generator(seed)

    def even(self, low: float, high: float) -> float:
        """Return a random number from `low` to `high` with a uniform distribution."""
        return float(self._random.uniform(low, high))

    def ratio(self, low: float, high: float) -> float:
        """Return a random number from `low` to `high` with a log-uniform distribution."""
        return float(low * (high / low) ** self._random.uniform())

    def sign(self, low: float, high: float) -> float:
        """Return a random number with a random sign, and with a magnitude as drawn by `ratio`."""
        return self.ratio(low, high) * self.one_of(-1, 1)

    def one_of(self, *values: Any) -> Any:
        """Return one of the values, all of which have the same probability."""
        return values[int(self._random.integers(len(values)))]

    def all_of(self, kind: Callable[..., _Cause]) -> _Cause:
        """Return an object of the class `kind` with random fields, all declared by `_range`."""
        of_class = fields(kind)  # type: ignore[arg-type]
        return kind(*(each.metadata['draw'](self) for each in of_class))


def generator(seed: np.random.SeedSequence) -> np.random.Generator:
    """Return a random number generator of the type that all simulations use."""
    return np.random.Generator(np.random.PCG64(seed))


def _range(draw: Callable[[_Draw, float, float], float], low: float, high: float) -> Any:
    """Return a dataclass field whose value `_Draw.all_of` draws at random from a range."""
    return field(metadata={'draw': lambda source: draw(source, low, high)})


_even, _ratio, _sign = (partial(_range, draw) for draw in (_Draw.even, _Draw.ratio, _Draw.sign))


@dataclass(frozen=True, slots=True)
class Rocking:
    """Rotation of the platform about its middle, which changes the reading."""

    mode: Platform
    # Relative change of the reading for a load at the outfeed end of the belt. For a load at the
    # infeed end, the change has the opposite sign.
    coupling: float


@dataclass(frozen=True, slots=True)
class Corner:
    """Relative error ``linear * p + square * p**2`` of the force of a load at the position p.

    The position p is -1 at the infeed and 1 at the outfeed.
    """

    linear: float = _sign(2e-4, 2e-3)
    square: float = _sign(2e-4, 2e-3)


@dataclass(frozen=True, slots=True)
class Transfer:
    """Forces of a product that crosses an end of the belt, in proportion to mass**power.

    The edges of the product strike the belt. The product also tips, so its force on the belt is not
    proportional to its length on the belt. Both forces have a mean, and a standard deviation from
    pass to pass.
    """

    # Mean peak force of a strike per kg and belt speed, in s/m.
    strike: float = _sign(0.002, 0.03)
    # Standard deviation of the peak force of a strike per kg and belt speed, in s/m.
    strike_spread: float = _ratio(0.002, 0.02)
    # Duration of a strike in s.
    duration: float = _ratio(0.003, 0.012)
    # Mean tipping force per kg while half of the product is on the belt.
    tipping: float = _sign(0.01, 0.06)
    # Standard deviation of the tipping force per kg.
    tipping_spread: float = _ratio(0.003, 0.03)
    # Exponent of the mass.
    power: float = _even(0.8, 1.4)


@dataclass(frozen=True, slots=True)
class Bounce:
    """Bounce of a product after its entry: a damped oscillation that differs from pass to pass."""

    # Standard deviations of the sine and the cosine part, per kg and speed, in s/m.
    size: float = _ratio(0.002, 0.015)
    # Mean frequency in Hz. From pass to pass, the frequency varies by at most 20 %, with a standard
    # deviation of 10 %.
    frequency: float = _ratio(8.0, 40.0)
    decay: float = _ratio(0.02, 0.08)  # time constant in s
    power: float = _even(0.8, 1.4)  # exponent of the mass, as in `Transfer`


@dataclass(frozen=True, slots=True)
class Roller:
    """Unbalanced roller, which vibrates at its rotation frequency and the harmonics."""

    diameter: float  # diameter in m
    amplitudes: tuple[float, ...]  # amplitudes by order from 1, per belt speed, in kg s/m
    wander: float  # standard deviation in rad of the angle from a uniform rotation
    growth: float  # relative increase of the amplitude with the load in 1/kg
    place: float  # position from -1 at the infeed to 1 at the outfeed


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint of the belt, which strikes the rollers at both ends once per revolution of the belt."""

    belt_length: float  # length of the belt in m
    width: float  # width of the joint in m
    size: float  # peak force per belt speed, in kg s/m


@dataclass(frozen=True, slots=True)
class Floor:
    """Vibration of the floor: noise from 4 Hz to 12 Hz, and sines.

    The phases and the amplitudes of the sines vary slowly.
    """

    noise: float  # standard deviation of the noise in kg
    lines: tuple[tuple[float, float], ...]  # frequency in Hz and mean amplitude in kg of each sine
    wander: float  # standard deviation of the phase of a sine in rad


@dataclass(frozen=True, slots=True)
class Amplifier:
    """Butterworth low-pass filter of the amplifier."""

    order: int
    cutoff: float  # cut-off frequency in Hz


@dataclass(frozen=True, slots=True)
class Drift:
    """Drift of the zero."""

    rate: float = _sign(3e-6, 5e-5)  # drift rate in kg/s
    wander: float = _ratio(2e-5, 2e-4)  # standard deviation in kg from a constant drift


@dataclass(frozen=True, slots=True)
class Creep:
    """Creep of the load cell, which is a slow change of the reading under a constant load."""

    share: float = _sign(1e-4, 1e-3)  # final change of the reading, relative to the load
    time: float = _ratio(3.0, 60.0)  # time constant in s


@dataclass(frozen=True, slots=True)
class EyeErrors:
    """Position errors of the photo-eyes, and time errors of their edges."""

    infeed: float = _even(-0.003, 0.003)  # position error in m, positive in belt direction
    outfeed: float = _even(-0.003, 0.003)  # position error in m, positive in belt direction
    jitter: float = _ratio(2e-5, 3e-4)  # standard deviation in s of the time of an edge


@dataclass(frozen=True, slots=True)
class Variation:
    """Standard deviations of speed, length and spacing from product to product."""

    speed: float = _ratio(1e-3, 5e-3)  # relative standard deviation of the belt speed
    length: float = _ratio(2e-3, 8e-3)  # relative standard deviation of the product length
    spacing: float = _even(0.02, 0.07)  # standard deviation of the spacing in m


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """Noise of belt and electronics."""

    # Square root of the one-sided power density per belt speed, in kg s/m / sqrt(Hz).
    broadband: float = _ratio(1e-5, 1e-4)
    electronic: float = _ratio(3e-6, 4e-5)  # standard deviation of the electronic noise in kg


@dataclass(frozen=True, slots=True)
class Setup:
    """Properties of a machine that are also fields of `SimulationParameters`."""

    sample_rate: float  # sample rate in Hz
    counts_per_kg: float  # static sensitivity in 1/kg
    product_length: float  # length of a product in m
    weigh_length: float  # distance between the photo-eyes in m
    spacing: float  # distance between the leading edges of successive products in m


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine of the family. A cause of disturbance is absent if its field is None."""

    setup: Setup
    platform: Platform
    rocking: Rocking | None
    corner: Corner | None
    transfer: Transfer | None
    bounce: Bounce | None
    rollers: tuple[Roller, ...] | None
    joint: Joint | None
    floor: Floor | None
    amplifier: Amplifier | None
    drift: Drift | None
    creep: Creep | None
    eyes: EyeErrors | None
    variation: Variation | None
    noise: NoiseLevels | None

    def without(self, *causes: str) -> Self:
        """Return the same machine without some causes of disturbance, given by field name."""
        absent: dict[str, Any] = dict.fromkeys(causes)
        return replace(self, **absent)


CAUSES = tuple(field.name for field in fields(Machine))[2:]


def machine_of(profile: str) -> Machine | None:
    """Return the machine of the profile ``machine:SEED`` or ``machine:SEED-CAUSE-CAUSE``.

    The causes of disturbance CAUSE are removed. Returns None for any other profile. Raises
    `ValueError` if the seed is not a whole number, or a cause is unknown.
    """
    if not profile.startswith(PREFIX):
        return None
    seed, *causes = profile.removeprefix(PREFIX).split('-')
    if not (seed.isascii() and seed.isdigit()):
        raise ValueError(f'the seed {seed!r} of the machine is not a whole number')
    for cause in causes:
        if cause not in CAUSES:
            raise ValueError(f'{cause!r} is not one of {", ".join(CAUSES)}')
    return draw(int(seed)).without(*causes)


def draw(seed: int) -> Machine:
    """Draw a machine at random. Equal seeds give equal machines.

    Each field of `Machine` has its own random numbers, so that a change of the range of one field
    does not change the numbers that are drawn for the others.
    """
    names = [each.name for each in fields(Machine)]
    seeds = np.random.SeedSequence(seed).spawn(len(names))
    streams = {name: _Draw(each) for name, each in zip(names, seeds, strict=True)}
    setup, own = _setup(streams['setup']), streams['platform']
    platform = Platform(own.ratio(18.0, 50.0), own.ratio(0.025, 0.1), own.even(1.5, 4.0))
    return Machine(
        setup=setup,
        platform=platform,
        rocking=_rocking(streams['rocking'], platform),
        corner=streams['corner'].all_of(Corner),
        transfer=streams['transfer'].all_of(Transfer),
        bounce=streams['bounce'].all_of(Bounce),
        rollers=tuple(map(_roller, [streams['rollers']] * streams['rollers'].one_of(1, 2, 3))),
        joint=_joint(streams['joint'], setup),
        floor=_floor(streams['floor']),
        amplifier=_amplifier(streams['amplifier']),
        drift=streams['drift'].all_of(Drift),
        creep=streams['creep'].all_of(Creep),
        eyes=streams['eyes'].all_of(EyeErrors),
        variation=streams['variation'].all_of(Variation),
        noise=streams['noise'].all_of(NoiseLevels),
    )


def _setup(draw: _Draw) -> Setup:
    product, plateau, gap = draw.even(0.08, 0.14), draw.even(0.07, 0.2), draw.even(0.3, 0.45)
    return Setup(
        sample_rate=draw.one_of(600.0, 800.0, 960.0, 1200.0),
        counts_per_kg=1e6 / draw.one_of(1.0, 2.0, 5.0, 10.0, 20.0),  # drawn in mg per count
        product_length=round(product, 3),
        weigh_length=round(product + plateau, 3),
        spacing=round(2 * product + plateau + gap, 3),
    )


def _rocking(draw: _Draw, platform: Platform) -> Rocking:
    frequency = platform.natural_frequency * draw.ratio(0.7, 2.0)
    mode = Platform(frequency, draw.ratio(0.02, 0.1), platform.moving_mass * draw.even(0.3, 1.0))
    return Rocking(mode, draw.sign(5e-4, 5e-3))


def _roller(draw: _Draw) -> Roller:
    first = draw.ratio(1e-4, 1e-3)
    falling = tuple(first * draw.even(0.2, 1.0) / order for order in range(2, 5))
    return Roller(
        diameter=draw.even(0.02, 0.06),
        amplitudes=(first, *falling),
        wander=draw.ratio(0.05, 1.0),
        growth=draw.even(0.5, 4.0),
        place=draw.even(-1, 1),
    )


def _joint(draw: _Draw, setup: Setup) -> Joint:
    # The belt runs around two rollers, which are 10 % to 50 % further apart than the
    # photo-eyes.
    belt = 2 * setup.weigh_length * draw.even(1.1, 1.5)
    return Joint(belt, draw.even(0.004, 0.015), draw.sign(5e-4, 5e-3))


def _floor(draw: _Draw) -> Floor:
    lines = tuple(
        (draw.even(5.0, 30.0), draw.ratio(1e-5, 1.5e-4)) for _ in range(draw.one_of(1, 2, 3))
    )
    return Floor(draw.ratio(2e-5, 1.5e-4), lines, draw.ratio(1.0, 10.0))


def _amplifier(draw: _Draw) -> Amplifier | None:
    order, cutoff = draw.one_of(1, 2, 3, 4), draw.ratio(15.0, 100.0)
    return draw.one_of(None, Amplifier(order, cutoff), Amplifier(order, cutoff))
