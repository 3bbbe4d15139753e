# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A family of belt scales: profile ``machine:SEED`` draws one of them at random.

A drawn machine has what a tidy model leaves out, each cause a field of `Machine` that `without`
takes away. The ranges are those of belt scales for products up to some kilograms, chosen by the
physics and not fitted to any one machine. Masses are kg, lengths m, forces kg (divided by g).
"""

from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

PREFIX = 'machine:'


@dataclass(frozen=True, slots=True)
class Mode:
    """A way in which the platform vibrates: a mass on a spring and a damper."""

    natural_frequency: float  # Hz, of the empty platform
    damping_ratio: float
    moving_mass: float  # kg


@dataclass(frozen=True, slots=True)
class Rocking:
    """Rocking of the platform about its middle, which the cell reads as a part of the load."""

    mode: Mode
    coupling: float  # reading of a load at the end of the belt, as a share of the load


@dataclass(frozen=True, slots=True)
class Corner:
    """Corner error: relative error of a load at p, from -1 at the infeed to 1 at the outfeed."""

    linear: float
    square: float


@dataclass(frozen=True, slots=True)
class Transfer:
    """What a product does as it crosses an end of the belt, in proportion to mass**power.

    Its edges strike the belt, and it tips: what rests on the belt is not the part that is past its
    end. Of both there is a part that is the same in each pass and one that is not.
    """

    strike: float  # s/m, peak force per kg and belt speed, mean over passes
    strike_spread: float  # s/m, standard deviation from edge to edge
    duration: float  # s, of the strike
    tipping: float  # share of the mass half way over the infeed end, mean over passes
    tipping_spread: float
    power: float  # 1 is proportional to the mass


@dataclass(frozen=True, slots=True)
class Bounce:
    """A product that bounces after it is on the belt: a damped swing, in each pass another."""

    size: float  # s/m, amplitude per kg and belt speed, standard deviation
    frequency: float  # Hz, varies by a tenth
    decay: float  # s
    power: float  # as that of `Transfer`


@dataclass(frozen=True, slots=True)
class Roller:
    """A roller whose unbalance shakes the belt at its turning and harmonics."""

    diameter: float  # m
    amplitudes: tuple[float, ...]  # kg s/m, per belt speed, by order from 1
    wander: float  # rad, standard deviation of the phase about its mean turning
    growth: float  # 1/kg, of the amplitude with the load
    place: float  # from -1 at the infeed to 1 at the outfeed


@dataclass(frozen=True, slots=True)
class Joint:
    """The joint of the belt, which strikes the rollers at both ends once in a turn of it."""

    belt_length: float  # m
    width: float  # m
    size: float  # kg s/m, peak force per belt speed


@dataclass(frozen=True, slots=True)
class Floor:
    """Vibration of the floor: noise between 4 and 12 Hz, and lines that drift."""

    noise: float  # kg, standard deviation
    lines: tuple[tuple[float, float], ...]  # Hz and kg
    wander: float  # rad, standard deviation of the phase; the amplitude breathes by a third


@dataclass(frozen=True, slots=True)
class Amplifier:
    """Low-pass of the amplifier, Butterworth."""

    order: int
    cutoff: float  # Hz


@dataclass(frozen=True, slots=True)
class Drift:
    """Zero that drifts."""

    rate: float  # kg/s
    wander: float  # kg, standard deviation about the straight line, over minutes


@dataclass(frozen=True, slots=True)
class Creep:
    """Creep of the load cell: the reading goes on to rise under a load, and comes back after it."""

    share: float
    time: float  # s


@dataclass(frozen=True, slots=True)
class Eyes:
    """Photo-eyes that stand off their places and jitter."""

    infeed: float  # m, along the belt
    outfeed: float
    jitter: float  # s, standard deviation of an edge


@dataclass(frozen=True, slots=True)
class Variation:
    """Standard deviations from product to product."""

    speed: float  # relative; as in a profile a new speed holds from each entry on
    length: float  # relative, of the product
    spacing: float  # m


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise of belt and electronics."""

    broadband: float  # kg s/m / sqrt(Hz), square root of the one-sided density per belt speed
    electronic: float  # kg, standard deviation of each sample


@dataclass(frozen=True, slots=True)
class Setup:
    """Values that `SimulationParameters` has, too: those of this machine where none are given."""

    sample_rate: float  # Hz
    counts_per_kg: float
    product_length: float  # m
    weigh_length: float  # m
    spacing: float  # m


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine of the family; a cause that is None is not there."""

    setup: Setup
    platform: Mode
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
    eyes: Eyes | None
    variation: Variation | None
    noise: Noise | None

    def without(self, *causes: str) -> Self:
        """Return the same machine without causes, which are named as their fields."""
        absent: dict[str, Any] = dict.fromkeys(causes)
        return replace(self, **absent)


CAUSES = tuple(field.name for field in fields(Machine))[2:]


def machine_of(profile: str) -> Machine | None:
    """Return the machine of ``machine:SEED`` or ``machine:SEED-CAUSE-CAUSE``, None of all others.

    Raises
    ------
    ValueError
        If the seed is no number from 0 on, or there is no such cause.
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
    """Draw a machine; equal seeds give equal machines.

    Each field draws from a stream of its own, so that a range that is changed changes no other.
    """
    streams = {
        field.name: _Draw(np.random.Generator(np.random.PCG64(child)))
        for field, child in zip(
            fields(Machine), np.random.SeedSequence(seed).spawn(len(fields(Machine))), strict=True
        )
    }
    setup = _setup(streams['setup'])
    platform = Mode(
        streams['platform'].ratio(18.0, 50.0), streams['platform'].ratio(0.025, 0.1),
        streams['platform'].even(1.5, 4.0),
    )  # fmt: skip
    return Machine(
        setup=setup,
        platform=platform,
        rocking=_rocking(streams['rocking'], platform),
        corner=Corner(streams['corner'].sign(2e-4, 2e-3), streams['corner'].sign(2e-4, 2e-3)),
        transfer=_transfer(streams['transfer']),
        bounce=_bounce(streams['bounce']),
        rollers=_rollers(streams['rollers']),
        joint=_joint(streams['joint'], setup),
        floor=_floor(streams['floor']),
        amplifier=_amplifier(streams['amplifier']),
        drift=Drift(streams['drift'].sign(3e-6, 5e-5), streams['drift'].ratio(2e-5, 2e-4)),
        creep=Creep(streams['creep'].sign(1e-4, 1e-3), streams['creep'].ratio(3.0, 60.0)),
        eyes=_eyes(streams['eyes']),
        variation=_variation(streams['variation']),
        noise=Noise(streams['noise'].ratio(1e-5, 1e-4), streams['noise'].ratio(3e-6, 4e-5)),
    )


class _Draw:
    """Draws from ranges."""

    def __init__(self, random: np.random.Generator) -> None:
        self._random = random

    def even(self, low: float, high: float) -> float:
        """Return a number from a range, all equally likely."""
        return float(self._random.uniform(low, high))

    def ratio(self, low: float, high: float) -> float:
        """Return a number from a range, all orders of magnitude equally likely."""
        return float(low * (high / low) ** self._random.uniform())

    def sign(self, low: float, high: float) -> float:
        """Return as `ratio` does, with a random sign."""
        return self.ratio(low, high) * self.one_of(-1, 1)

    def one_of(self, *values: Any) -> Any:
        """Return one of some values."""
        return values[int(self._random.integers(len(values)))]


def _setup(draw: _Draw) -> Setup:
    product, plateau, gap = draw.even(0.08, 0.14), draw.even(0.07, 0.2), draw.even(0.3, 0.45)
    return Setup(
        sample_rate=draw.one_of(600.0, 800.0, 960.0, 1200.0),
        counts_per_kg=1e6 / draw.one_of(1.0, 2.0, 5.0, 10.0, 20.0),  # mg, one step
        product_length=round(product, 3),
        weigh_length=round(product + plateau, 3),
        spacing=round(2 * product + plateau + gap, 3),
    )


def _rocking(draw: _Draw, platform: Mode) -> Rocking:
    frequency = platform.natural_frequency * draw.ratio(0.7, 2.0)
    mode = Mode(frequency, draw.ratio(0.02, 0.1), platform.moving_mass * draw.even(0.3, 1.0))
    return Rocking(mode, draw.sign(5e-4, 5e-3))


def _transfer(draw: _Draw) -> Transfer:
    return Transfer(
        strike=draw.sign(0.002, 0.03), strike_spread=draw.ratio(0.002, 0.02),
        duration=draw.ratio(0.003, 0.012), tipping=draw.sign(0.01, 0.06),
        tipping_spread=draw.ratio(0.003, 0.03), power=draw.even(0.8, 1.4),
    )  # fmt: skip


def _bounce(draw: _Draw) -> Bounce:
    return Bounce(
        draw.ratio(0.002, 0.015), draw.ratio(8.0, 40.0), draw.ratio(0.02, 0.08),
        draw.even(0.8, 1.4),
    )  # fmt: skip


def _rollers(draw: _Draw) -> tuple[Roller, ...]:
    rollers = []
    for _ in range(draw.one_of(1, 2, 3)):
        first = draw.ratio(1e-4, 1e-3)
        falling = tuple(first * draw.even(0.2, 1.0) / order for order in range(2, 5))
        rollers.append(
            Roller(
                diameter=draw.even(0.02, 0.06), amplitudes=(first, *falling),
                wander=draw.ratio(0.05, 1.0), growth=draw.even(0.5, 4.0), place=draw.even(-1, 1),
            )
        )  # fmt: skip
    return tuple(rollers)


def _joint(draw: _Draw, setup: Setup) -> Joint:
    # Around both rollers, which are as far apart as the eyes.
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


def _eyes(draw: _Draw) -> Eyes:
    return Eyes(draw.even(-0.003, 0.003), draw.even(-0.003, 0.003), draw.ratio(2e-5, 3e-4))


def _variation(draw: _Draw) -> Variation:
    return Variation(draw.ratio(1e-3, 5e-3), draw.ratio(2e-3, 8e-3), draw.even(0.02, 0.07))
