# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signal of the load cell of a randomly drawn machine, with a function for each disturbance."""

from dataclasses import replace
import math

import numpy as np

from checkweigher_recording.simulation.belt_travel import BeltTravel, Pass
from checkweigher_recording.simulation.machine import (
    Bounce,
    Machine,
    Roller,
    Transfer,
    generator,
)
from checkweigher_recording.simulation.noise import Array, FloorNoise, Wander, white
from checkweigher_recording.simulation.platform_dynamics import PlatformDynamics

_TYPICAL_MASS = 0.165  # reference mass of the disturbance parameters in kg


def positions(entry: Pass, travel: Array, weigh_length: float) -> Array:
    """Return the centre of the part of a product that is on the belt, (n,) from -1 to 1.

    The position is -1 at the infeed and 1 at the outfeed. `travel` is the travel of the belt while
    the product is on the belt, (n,) in m.
    """
    way = travel - entry.travel
    return (np.minimum(way, weigh_length) + np.maximum(way - entry.length, 0.0)) / weigh_length - 1


def transfer_force(
    transfer: Transfer, entry: Pass, share: Array, numbers: Array, time: Array
) -> Array:
    """Return the force of a product that crosses the ends of the belt, (n,) in kg.

    `share` is the fraction of the product that is on the belt at `time`, (n,) in s. `numbers` are
    standard normal random numbers of the pass, (5,).
    """
    of_end = np.where(time < (entry.t2 + entry.t3) / 2, numbers[0], numbers[1])
    force = (transfer.tipping + transfer.tipping_spread * of_end) * np.sin(math.pi * share)
    for begin, number in zip((entry.t1, entry.t2, entry.t3), numbers[2:], strict=True):
        size = (transfer.strike + transfer.strike_spread * number) * _speed(entry)
        force += size * _half_sine((time - begin) / transfer.duration)
    return _weight(entry, transfer.power) * force


def bounce_force(bounce: Bounce, entry: Pass, numbers: Array, time: Array) -> Array:
    """Return the force of a bouncing product, (n,) in kg, at `time`, (n,) in s.

    The bounce begins at the middle of the entry. `numbers` are standard normal random numbers of
    the pass, (3,).
    """
    since = time - (entry.t1 + entry.t2) / 2
    angle = 2 * math.pi * bounce.frequency * (1 + 0.1 * float(np.clip(numbers[2], -2, 2)))
    swing = numbers[0] * np.sin(angle * since) + numbers[1] * np.cos(angle * since)
    fading = np.exp(-np.maximum(since, 0.0) / bounce.decay)
    size = bounce.size * _speed(entry) * _weight(entry, bounce.power)
    return np.where(since > 0, size * swing * fading, 0.0)


def roller_force(
    roller: Roller, phases: Array, wander: Wander, travel: Array, load: Array, speed: float
) -> Array:
    """Return the force of a roller, (n,) in kg.

    `phases` contains the phase in rad of each order of the vibration. `wander` returns the
    deviation of the roller angle from a uniform rotation at a belt travel in m, divided by the
    standard deviation of this angle. `travel` is the belt travel, (n,) in m, `load` is the mass on
    the belt, (n,) in kg, and `speed` is the belt speed in m/s.
    """
    angle = 2 * travel / roller.diameter + roller.wander * wander(travel)
    force = np.zeros(len(travel))
    lines = zip(roller.amplitudes, phases, strict=True)
    for order, (amplitude, phase) in enumerate(lines, start=1):
        force += speed * amplitude * np.sin(order * angle + phase)
    return force * (1 + roller.growth * load)


def _weight(entry: Pass, power: float) -> float:
    return float(_TYPICAL_MASS * (entry.mass / _TYPICAL_MASS) ** power)


def _speed(entry: Pass) -> float:
    return entry.length / (entry.t2 - entry.t1)


def _half_sine(phase: Array) -> Array:
    """Return ``sin(pi * phase)`` for phases from 0 to 1, and 0 for other phases."""
    return np.where((phase >= 0) & (phase < 1), np.sin(math.pi * phase), 0.0)


class MachineSignal:
    """Load-cell signal of a randomly drawn machine.

    Each call of `reading` continues the signal of the previous call.
    """

    def __init__(
        self,
        machine: Machine,
        belt: BeltTravel,
        weigh_length: float,
        step: float,
        seed: np.random.SeedSequence,
    ) -> None:
        """Create the signal of an empty platform at rest. `step` is the integration step in s."""
        self._machine, self._belt, self._step = machine, belt, step
        self._weigh_length = weigh_length  # distance between the photo-eyes in m
        drawn, broadband, floor, electronic, passes = seed.spawn(5)
        self._broadband, self._electronic = generator(broadband), generator(electronic)
        self._passes = int(passes.generate_state(1)[0])
        random = generator(drawn)
        self._rollers = [
            (roller, 2 * math.pi * random.random(len(roller.amplitudes)), Wander(random, 0.05, 5.0))
            for roller in machine.rollers or ()
        ]
        self._joint = float(random.random())
        self._lines = [
            (*line, Wander(random, 0.003, 0.1), Wander(random, 0.003, 0.1))
            for line in (machine.floor.lines if machine.floor else ())
        ]
        self._zero = Wander(random, 1 / 600, 1 / 30)
        self._floor = FloorNoise(1 / step, generator(floor))
        self._platform = PlatformDynamics(machine.platform, step)
        self._rocking = PlatformDynamics(machine.rocking.mode, step) if machine.rocking else None
        self._low_pass, self._low_pass_state = _low_pass(machine, step)
        self._crept = np.zeros(1)

    def seen(self, entry: Pass) -> Pass:
        """Return a copy of the pass, with the times that the photo-eyes report.

        If the machine has no errors of the photo-eyes, the pass is returned unchanged.
        """
        eyes = self._machine.eyes
        if eyes is None:
            return entry
        places = np.array((eyes.infeed, eyes.infeed, eyes.outfeed, eyes.outfeed))
        late = places / _speed(entry) + eyes.jitter * np.clip(self._numbers(entry)[:4], -3, 3)
        t1, t2, t3, t4 = (np.array((entry.t1, entry.t2, entry.t3, entry.t4)) + late).tolist()
        return replace(entry, t1=t1, t2=t2, t3=t3, t4=t4)

    def reading(self, time: Array, travel: Array) -> Array:
        """Return the readings at the start of each of the next n steps, (n,) in kg.

        `time` is the time of the middle of each step, (n,) in s, and `travel` is the belt travel at
        that time, (n,) in m.
        """
        from scipy.signal import lfilter, sosfilt  # imported late, because the import is slow

        force, moment = self._products(time, travel)
        self._add_belt(force, moment, time, travel)
        self._add_floor(force, time)
        steps = self._belt.load_steps(time, travel)
        reading = self._platform.run(force, *steps)
        if self._rocking is not None and self._machine.rocking:
            reading += self._machine.rocking.coupling * self._rocking.run(moment, *steps)
        if creep := self._machine.creep:
            rest = math.exp(-self._step / creep.time)
            crept, self._crept = lfilter((1 - rest,), (1.0, -rest), reading, zi=self._crept)
            reading += creep.share * crept
        if len(self._low_pass):
            reading, self._low_pass_state = sosfilt(
                self._low_pass, reading, zi=self._low_pass_state
            )
        return reading

    def electronics(self, reading: Array, time: Array) -> Array:
        """Return the readings, (n,) in kg, with drift and noise of the electronics."""
        samples = reading.copy()
        if drift := self._machine.drift:
            samples += drift.rate * time + drift.wander * self._zero(time)
        if noise := self._machine.noise:
            samples += noise.electronic * self._electronic.standard_normal(len(samples))
        return samples

    def _products(self, time: Array, travel: Array) -> tuple[Array, Array]:
        """Return force and moment of the products, (n,) each.

        The moment is divided by half the distance between the photo-eyes, so both are in kg. The
        force includes the mass that rests on the belt, which has no moment.
        """
        force, moment = np.full(len(time), self._belt.resting), np.zeros(len(time))
        machine = self._machine
        for entry, touched in self._belt.touched(time):
            share = self._belt.share(entry, travel[touched])
            place = positions(entry, travel[touched], self._weigh_length)
            own = entry.mass * share
            numbers = self._numbers(entry)[4:]
            if machine.transfer:
                own += transfer_force(machine.transfer, entry, share, numbers[:5], time[touched])
            if machine.bounce:
                own += bounce_force(machine.bounce, entry, numbers[5:], time[touched])
            moment[touched] += own * place
            if machine.corner:
                own *= 1 + machine.corner.linear * place + machine.corner.square * place**2
            force[touched] += own
        return force, moment

    def _add_belt(self, force: Array, moment: Array, time: Array, travel: Array) -> None:
        """Add the forces of rollers, belt joint and broadband noise, and the moments, all in kg.

        The broadband noise has no moment. The moments are divided by half the distance between the
        photo-eyes.
        """
        load, speed = self._belt.load(time, travel), self._belt.speed
        for roller, phases, wander in self._rollers:
            shaking = roller_force(roller, phases, wander, travel, load, speed)
            force += shaking
            moment += roller.place * shaking
        if joint := self._machine.joint:
            # Travel in m at which the joint reaches the infeed roller for the first time.
            first = self._joint * joint.belt_length
            for end, place in ((first, -1), (first + self._weigh_length, 1)):
                phase = ((travel - end) % joint.belt_length) / joint.width
                struck = joint.size * speed * _half_sine(phase)
                force += struck
                moment += place * struck
        if noise := self._machine.noise:
            force += white(noise.broadband * speed, self._step, len(force), self._broadband)

    def _add_floor(self, force: Array, time: Array) -> None:
        if floor := self._machine.floor:
            force += floor.noise * self._floor(len(force))
            for frequency, amplitude, phase, breath in self._lines:
                angle = 2 * math.pi * frequency * time + floor.wander * phase(time)
                force += amplitude * (1 + breath(time) / 3) * np.sin(angle)

    def _numbers(self, entry: Pass) -> Array:
        return np.random.default_rng((self._passes, entry.number)).standard_normal(12)


def _low_pass(machine: Machine, step: float) -> tuple[Array, Array]:
    """Return the second-order sections of the amplifier's low-pass filter, and their states.

    If the machine has no amplifier, there are no sections: the arrays have the shapes (0, 6) and
    (0, 2).
    """
    from scipy.signal import butter

    sections = np.zeros((0, 6))
    if amplifier := machine.amplifier:
        sections = butter(amplifier.order, amplifier.cutoff, fs=1 / step, output='sos')
    return sections, np.zeros((len(sections), 2))
