# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulation of a weigh belt with platform, products, disturbances, converter and photo-eyes.

The platform is a mass on a spring and a damper. The displacement x of the platform is expressed as
the static reading y = beta x / g in kg, where beta is the stiffness:

    y'' = w^2 (f - y) - c / (m0 + m) y',    w^2 = beta / (m0 + m).

Here m0 is the moving mass of the empty platform, m is the mass of the load, c is the damping
coefficient, and f is the sum of all forces divided by g. A load at rest therefore gives a reading
equal to its mass, and lowers the natural frequency.

One sample has 8 integration steps. The force is constant during a step and equals its value in the
middle of the step. The integration is exact for forces that are constant during a step, so it adds
no numerical damping or delay. The converter averages the 8 readings of a sample. The time stamp of
a sample is the middle of its interval, so that the average has no delay.

With a `Profile`, the forces are the weight of the load, an impact of random sign when a product
enters, vibrations of rollers and motor, broadband noise, and the vibration of the floor. The weight
changes linearly while a product crosses an end of the belt. The impact, the vibrations of rollers
and motor, and the broadband noise are proportional to the belt speed. The module `machine`
describes the forces of a randomly drawn machine. The converter adds white noise, drift and
quantisation, and clips the signal. The platform is at rest at the first sample.
"""

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
import math
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.recording import Event, Recording, canonical_order
from checkweigher_core.records import NANOSECONDS, EyeEdge, LoadCell, Reference, SampleBlock
from checkweigher_dsp.signal.platform_response import Platform
from checkweigher_recording.simulation.belt_travel import STEADY, BeltTravel, Pass
from checkweigher_recording.simulation.filler import Filler
from checkweigher_recording.simulation.machine import PREFIX, generator, machine_of
from checkweigher_recording.simulation.machine_signal import MachineSignal
from checkweigher_recording.simulation.noise import Array, FloorNoise, white
from checkweigher_recording.simulation.operation import CAPACITY, OperationParameters
from checkweigher_recording.simulation.platform_dynamics import PlatformDynamics

OVERSAMPLING = 8  # integration steps per sample
ROLLER_DIAMETER = 0.032  # diameter of a roller in m
MIN_COUNTS, MAX_COUNTS = -(2**23), 2**23 - 1  # range of a 24-bit converter
MOVING_MASS = 2.5  # moving mass of the empty platform in kg
DAMPING_RATIO = 0.06  # damping ratio of the empty platform
IMPACT_DURATION = 0.0035  # duration of the impact at entry in s

_CHUNK_DURATION = 1.0  # approximate duration in s of the signal that is computed in one piece


@dataclass(frozen=True, slots=True)
class Profile:
    """Platform and disturbances of a machine. A force in kg is the force in N divided by g."""

    # Natural frequency of the empty platform in Hz.
    natural_frequency: float = 38.0
    # Relative standard deviation of the belt speed, which changes after each spacing of travel.
    speed_jitter: float = 0.001
    # Standard deviation of the peak force at entry, per product mass and belt speed, in s/m.
    impact: float = 0.03
    # Amplitudes of the roller vibration and its harmonics, per belt speed, in kg s/m.
    roller: tuple[float, ...] = (0.42e-3, 0.3e-3, 0.24e-3, 0.18e-3)
    # Amplitude of the motor vibration per belt speed, in kg s/m.
    motor: float = 0.5e-3
    # Frequency of the motor vibration per belt speed, in 1/m.
    motor_frequency: float = 31.0
    # Square root of the one-sided power density of the noise, per belt speed, in kg s/m / sqrt(Hz).
    broadband: float = 0.033e-3
    # Standard deviation of the floor vibration in kg.
    floor: float = 0.05e-3
    # Standard deviation of the white noise of the converter in kg.
    electronic: float = 0.05e-3


# `paper` resembles the machine of Long et al.: with a good estimator, the standard deviation of the
# mass is 0.03 g to 0.05 g at 30 m/min and 0.15 g to 0.3 g at 90 m/min.
PROFILES = {
    'paper': Profile(),
    # The rollers are worn, and their vibration dominates.
    'roller': Profile(roller=(5.5e-3, 3.5e-3, 2.5e-3, 1.5e-3)),
    # The natural frequency of the platform is close to the harmonics of the rollers.
    'soft': Profile(
        natural_frequency=22.0, roller=(1.5e-3, 1.05e-3, 0.85e-3, 0.65e-3), broadband=0.02e-3
    ),
    # The belt runs smoothly, and the vibration of the floor dominates.
    'floor': Profile(
        roller=(0.08e-3, 0.06e-3, 0.05e-3, 0.04e-3), motor=0.1e-3, broadband=0.01e-3, floor=0.2e-3
    ),
    # The only disturbance is the noise of the electronics.
    'quiet': Profile(speed_jitter=0.0, impact=0.0, roller=(), motor=0.0, broadband=0.0, floor=0.0),
}


def check_profile(profile: str) -> None:
    """Raise `ParameterError` unless `profile` is the name of a profile.

    Valid names are the keys of `PROFILES`, and the names that `machine_of` accepts.
    """
    try:
        if machine_of(profile) is None and profile not in PROFILES:
            raise ParameterError(
                f'simulator.profile: {profile!r} is not one of {", ".join(PROFILES)} or '
                f'{PREFIX}SEED'
            )
    except ValueError as error:
        raise ParameterError(f'simulator.profile: {profile!r}: {error}') from None


@dataclass(frozen=True)
class SimulationParameters(Parameters):
    """Parameters of a simulated line: its machine, belt and products.

    Raises `ParameterError` if a value is out of its range, the profile is unknown, there are no
    masses, the sensitivity is 0, or the products would overlap.
    """

    node: ClassVar[str] = 'simulator'

    profile: str = parameter(
        'paper',
        f'machine with its disturbances: {", ".join(PROFILES)}, or machine:SEED '
        'for a random machine; machine:SEED-CAUSE-CAUSE removes causes of disturbance',
    )
    speed: float = parameter(1.0, 'belt speed', unit='m/s', minimum=0.01, maximum=5.0)
    masses: tuple[float, ...] = parameter(
        (0.0745, 0.1345, 0.1645, 0.1945, 0.2545),
        'masses of the products, used cyclically',
        unit='kg',
        minimum=0.0,
        maximum=CAPACITY,
    )
    count: int = parameter(25, 'number of products; 0 for an endless line', minimum=0)
    spacing: float = parameter(
        0.66,
        'distance between the leading edges of successive products',
        unit='m',
        minimum=0.01,
        maximum=100.0,
    )
    product_length: float = parameter(
        0.1, 'length of a product along the belt', unit='m', minimum=0.001, maximum=10.0
    )
    weigh_length: float = parameter(
        0.2, 'distance between infeed and outfeed eye', unit='m', minimum=0.01, maximum=10.0
    )
    zero_drift: float = parameter(
        0.0, 'drift rate of the zero', unit='kg/s', minimum=-0.01, maximum=0.01
    )
    filler_drift: float = parameter(
        0.0,
        'change of the filled mass from product to product',
        unit='kg',
        minimum=-0.01,
        maximum=0.01,
    )
    filler_spread: float = parameter(
        0.0,
        'standard deviation of the filled mass',
        unit='kg',
        minimum=0.0,
        maximum=1.0,
    )
    filler_delay: int = parameter(
        0, 'number of filled products before the belt', minimum=0, maximum=10_000
    )
    lead_in: float = parameter(
        2.0, 'time of empty belt before the first product', unit='s', minimum=0.0, maximum=3600.0
    )
    run_out: float = parameter(
        1.0, 'time of empty belt after the last product', unit='s', minimum=0.0, maximum=3600.0
    )
    seed: int = parameter(1, 'seed of all random numbers', minimum=0)
    start_time: int = parameter(
        1_700_000_000,
        'time of the first sample since 1970',
        unit='s',
        minimum=0,
        maximum=2_000_000_000,
    )
    sample_rate: float = parameter(960.0, 'sample rate', unit='Hz', minimum=100.0, maximum=20_000.0)
    samples_per_block: int = parameter(10, 'samples per block', minimum=1, maximum=10_000)
    counts_per_kg: float = parameter(
        500_000.0, 'static sensitivity', unit='1/kg', minimum=-1e6, maximum=1e6
    )
    zero_counts: float = parameter(
        1_250_000.0, 'reading of the empty belt in counts', minimum=MIN_COUNTS, maximum=MAX_COUNTS
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_profile(self.profile)
        if not self.masses:
            raise ParameterError('simulator.masses: is empty, but at least one mass is needed')
        if self.counts_per_kg == 0:
            raise ParameterError('simulator.counts_per_kg: is 0, but must differ from 0')
        if self.spacing <= self.product_length:
            raise ParameterError(
                f'simulator.spacing: {self.spacing:g} m is not above product_length '
                f'{self.product_length:g} m'
            )


def own_values(profile: str) -> dict[str, float]:
    """Return the values of `SimulationParameters` that belong to a randomly drawn machine.

    The values are the sample rate, the sensitivity and the lengths. The caller must pass the values
    to `SimulationParameters`, which does not derive them from the profile. The dict is empty if the
    profile is not a randomly drawn machine.

    Raises `ValueError` if the seed or a cause of the profile is not valid.
    """
    machine = machine_of(profile)
    return asdict(machine.setup) if machine else {}


class Simulation:
    """Iterable over the events of a simulated line in canonical order.

    Each iteration restarts the line. All iterations yield the same events if `operation`, `start`
    and the correction of the filler do not change. If the parameter ``count`` is 0, the iteration
    does not end. Events are not kept in memory. The properties of a product do not depend on the
    number of products that follow it.
    """

    def __init__(self, parameters: SimulationParameters) -> None:
        # Settings of the operator. New settings may be assigned at any time, and take effect in the
        # next chunk of the signal, which usually begins within one second of signal time.
        self.operation = OperationParameters()
        # Function that returns the time stamp in ns of the first sample of an iteration. The first
        # chunk of the signal is computed before the call, because the computation takes time.
        self.start: Callable[[], int] = lambda: parameters.start_time * NANOSECONDS
        self._begin = 0
        self._parameters = parameters
        self.load_cell = LoadCell.of(
            parameters,
            min_counts=MIN_COUNTS,
            max_counts=MAX_COUNTS,
            capacity=CAPACITY,
            model='simulated',
            serial_number=f'{parameters.profile}-{parameters.seed}',
        )
        # Filler of the latest iteration, or None before the first one. A new correction applies to
        # the products that are filled for the next chunk of the signal and later.
        self.filler: Filler | None = None

    def __iter__(self) -> Iterator[Event]:
        """Yield sample blocks, edges of the photo-eyes and reference masses in canonical order."""
        rate, size = self._parameters.sample_rate, self._parameters.samples_per_block
        machine = _Machine(self._parameters)
        self.filler = machine.filler
        waiting: list[Event] = []
        chunk = size * max(1, round(_CHUNK_DURATION * rate / size))
        first = 0
        while machine.total is None or first < machine.total:
            machine.operate(self.operation)
            counts, passes = machine.run(first, first + chunk)
            if first == 0:
                self._begin = self.start()
            for begin in range(0, len(counts), size):
                index = first + begin
                block = counts[begin : begin + size]
                waiting.append(SampleBlock(self._stamp(index / rate), index, block))
            for entry in passes:
                waiting += self._switches(entry)
            waiting.sort(key=canonical_order)
            first += len(counts)
            ready = bisect_left(waiting, self._stamp(first / rate), key=attrgetter('stamp'))
            yield from waiting[:ready]
            del waiting[:ready]

    def _switches(self, entry: Pass) -> Iterator[Event]:
        """Yield the edges of the photo-eyes for a product, and its true mass as a reference."""
        for time, eye, blocked in self.operation.switches(entry):
            yield EyeEdge(self._stamp(time), eye, blocked)
        yield Reference(self._stamp(entry.t1), entry.mass)

    def _stamp(self, time: float) -> int:
        # Whole seconds are added as integers, because a float resolves a time since 1970 to only
        # about 200 ns.
        whole = math.floor(time)
        return self._begin + whole * NANOSECONDS + round((time - whole) * NANOSECONDS)


def simulate(parameters: SimulationParameters) -> Recording:
    """Return the recording of a simulated line. Equal parameters give equal recordings.

    The recording contains one reference mass for each product.

    Raises `ParameterError` if the number of products is not limited.
    """
    if parameters.count == 0:
        raise ParameterError('simulator.count: 0 is an endless line, which has no recording')
    simulation = Simulation(parameters)
    return Recording.from_events(simulation.load_cell, simulation)


class _Machine:
    """Belt, load-cell signal and converter during one iteration of a `Simulation`."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self.total: int | None = None
        self._put: int | None = None  # number of products put by hand; None before the first chunk
        self._zero = self._lead = 0.0
        self._parameters = parameters
        self._rate = OVERSAMPLING * parameters.sample_rate
        # Each cause of disturbance has its own random numbers, so that a change of one cause does
        # not affect the others.
        passes, *sources, products, drawn, filled = np.random.SeedSequence(parameters.seed).spawn(8)
        profile, machine = PROFILES.get(parameters.profile), machine_of(parameters.profile)
        self.filler = Filler(
            parameters.masses,
            parameters.filler_drift,
            parameters.filler_spread,
            parameters.filler_delay,
            generator(filled),
        )
        variation = (machine and machine.variation) or STEADY
        if profile:
            variation = replace(STEADY, speed=profile.speed_jitter)
        streams = generator(passes), generator(products)
        self._belt = BeltTravel(parameters, variation, *streams, self.filler.next_mass)
        self._signal: _ProfileSignal | MachineSignal
        if profile:
            self._signal = _ProfileSignal(profile, self._belt, 1 / self._rate, sources)
        elif machine:
            length = parameters.weigh_length
            self._signal = MachineSignal(machine, self._belt, length, 1 / self._rate, drawn)

    def operate(self, operation: OperationParameters) -> None:
        """Apply the settings of the operator to the next samples.

        The products that were put by hand since the previous call are added to the belt. The first
        call adds no products.
        """
        belt = self._belt
        belt.speed, belt.feed = operation.speed or self._parameters.speed, operation.feed
        belt.mass, belt.resting, belt.gap = operation.mass, operation.load, operation.gap
        if self._put is not None:
            belt.by_hand += [operation.put_mass] * (operation.put - self._put)
        self._put, self._zero, self._lead = operation.put, operation.zero, operation.lead

    def run(self, first: int, end: int) -> tuple[NDArray[np.int32], list[Pass]]:
        """Return the counts of the samples from `first` to before `end`, and the new passes.

        `first` must be 0 in the first call, and `end` of the previous call in later calls. If the
        line ends before `end`, there are fewer samples. The passes contain the times that the
        photo-eyes report.
        """
        # An eye that is displaced against the belt direction sees a product earlier, so passes that
        # begin after `end` are planned as well.
        until = end / self._parameters.sample_rate + self._lead / self._belt.speed
        new = self._belt.plan(self._middle(first), until)
        if self._belt.last_exit is not None:
            duration = self._belt.last_exit + self._parameters.run_out
            self.total = math.ceil(duration * self._parameters.sample_rate) + 1
            end = min(end, self.total)
        time = self._middle(first) + np.arange((end - first) * OVERSAMPLING) / self._rate
        reading = self._signal.reading(time, self._belt.travel(time))
        samples = reading.reshape(-1, OVERSAMPLING).mean(axis=1)
        return self._convert(samples, first), [self._signal.seen(entry) for entry in new]

    def _middle(self, index: int) -> float:
        """Return the time in s of the middle of the first integration step of a sample.

        A reading belongs to the start of a step. The starts of the steps of a sample are symmetric
        about the time stamp of the sample, so that the average of the readings has no delay.
        """
        return (index * OVERSAMPLING - (OVERSAMPLING - 1) / 2 + 0.5) / self._rate

    def _convert(self, reading: Array, first: int) -> NDArray[np.int32]:
        """Return the counts of the converter for readings in kg, with noise, drift and clipping."""
        parameters = self._parameters
        time = (first + np.arange(len(reading))) / parameters.sample_rate
        samples = self._signal.electronics(reading, time)
        drift = parameters.zero_drift * time + self._zero
        counts = parameters.zero_counts + parameters.counts_per_kg * (samples + drift)
        return np.clip(np.rint(counts), MIN_COUNTS, MAX_COUNTS).astype(np.int32)


class _ProfileSignal:
    """Load-cell signal of a machine with a `Profile`.

    Each call of `reading` continues the signal of the previous call.
    """

    def __init__(
        self,
        profile: Profile,
        belt: BeltTravel,
        step: float,
        seeds: Sequence[np.random.SeedSequence],
    ) -> None:
        self._profile, self._belt, self._step = profile, belt, step
        phases, self._broadband, floor, self._electronic = map(generator, seeds)
        self._phases = 2 * math.pi * phases.random(len(profile.roller) + 1)
        platform = Platform(profile.natural_frequency, DAMPING_RATIO, MOVING_MASS)
        self._platform = PlatformDynamics(platform, step)
        self._floor = FloorNoise(1 / step, floor)

    def seen(self, entry: Pass) -> Pass:
        """Return the pass unchanged, because these photo-eyes report the exact times."""
        return entry

    def reading(self, time: Array, travel: Array) -> Array:
        """Return the readings at the start of each of the next n steps, (n,) in kg.

        `time` is the time of the middle of each step, (n,) in s, and `travel` is the belt travel at
        that time, (n,) in m.
        """
        force = self._belt.load(time, travel)
        self._add_lines(force, travel)
        density = self._profile.broadband * self._belt.speed
        force += white(density, self._step, len(force), self._broadband)
        force += self._profile.floor * self._floor(len(force))
        for entry in self._belt.passes:  # The impact at the entry has the form of a half sine.
            size = self._profile.impact * entry.mass * self._belt.speed * entry.impact
            begin, end = np.searchsorted(time, (entry.t1, entry.t1 + IMPACT_DURATION))
            phase = (time[begin:end] - entry.t1) / IMPACT_DURATION
            force[begin:end] += size * np.sin(math.pi * phase)
        return self._platform.run(force, *self._belt.load_steps(time, travel))

    def electronics(self, reading: Array, time: Array) -> Array:
        """Return the readings, (n,) in kg, with the noise of the electronics."""
        return reading + self._profile.electronic * self._electronic.standard_normal(len(reading))

    def _add_lines(self, force: Array, travel: Array) -> None:
        """Add the vibration of rollers and motor, whose phases follow the belt travel."""
        *roller, motor = self._phases
        lines = zip(self._profile.roller, roller, strict=True)
        for order, (amplitude, phase) in enumerate(lines, start=1):
            angle = 2 * order / ROLLER_DIAMETER * travel + phase
            force += self._belt.speed * amplitude * np.sin(angle)
        angle = 2 * math.pi * self._profile.motor_frequency * travel + motor
        force += self._belt.speed * self._profile.motor * np.sin(angle)
