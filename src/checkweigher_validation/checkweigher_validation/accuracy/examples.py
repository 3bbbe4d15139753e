# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signals of a pass for the figures of a report."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from numpy.typing import NDArray
import pywt

from checkweigher_core.records import WeighWindow, seconds
from checkweigher_dsp.denoising.denoiser import METHODS, DenoiseParameters, Denoiser
from checkweigher_dsp.denoising.wavelet_shrinkage import LEVELS, WAVELET
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.platform_response import Crossing, Platform, responses
from checkweigher_recording.simulation.simulator import (
    DAMPING_RATIO,
    MOVING_MASS,
    PROFILES,
    Simulation,
    SimulationParameters,
)
from checkweigher_validation.accuracy.passes import KnownPass, known_passes

_PRODUCTS = 3  # number of simulated products, of which the last one is the example
_LEAD = 0.15  # duration of the signal before t1 in s
_TRAIL = 1.0  # largest duration of the signal after t3 in s


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """Signals of one pass in kg. Times are in s from the first sample."""

    speed: float  # nominal belt speed in m/s
    mass: float  # true mass in kg
    sample_rate: float  # Hz
    t1: float  # time at which the product begins to enter the belt
    t2: float  # time at which the product is completely on the belt
    t3: float  # time at which the product begins to leave the belt
    t4: float  # time at which the product has left the belt, computed for a constant belt speed
    signal: NDArray[np.float64]  # signal minus the zero, (n,)
    ideal: NDArray[np.float64]  # signal without noise, (n,), or empty if the platform is unknown.
    # Name and signal from t2 to t3 for each method of thresholding: hard, soft, shrinkage.
    denoised: tuple[tuple[str, NDArray[np.float64]], ...] = ()
    # Name and signal, (n,), of each band of the stationary wavelet transform: a7, d7 to d1.
    bands: tuple[tuple[str, NDArray[np.float64]], ...] = ()

    @property
    def window(self) -> slice:
        """Slice of the samples at or after t2 and before t3."""
        # Round first, because otherwise a rounding error could place a sample at exactly t2 or t3
        # on the wrong side.
        begin, end = (math.ceil(round(time * self.sample_rate, 6)) for time in (self.t2, self.t3))
        return slice(max(begin, 0), min(end, len(self.signal)))


def simulated_examples(
    profile: str, speeds: Sequence[float], mass: float, parameters: LineParameters, seed: int
) -> tuple[Example, ...]:
    """Return a simulated pass of a product of `mass` in kg at each of the `speeds` in m/s.

    `profile` is the name of the simulated machine in `PROFILES`, and `seed` is the seed of the
    simulation. `parameters` contains the parameters of the segmenter and of the denoiser.
    """
    segmenter = replace(parameters.segmenter, trail_time=_TRAIL)
    platform = Platform(PROFILES[profile].natural_frequency, DAMPING_RATIO, MOVING_MASS)
    line = SimulationParameters(profile=profile, masses=(mass,), count=_PRODUCTS, seed=seed)
    examples = []
    for speed in speeds:
        simulation = Simulation(replace(line, speed=speed))
        shown = known_passes(simulation.load_cell, simulation, segmenter)[-1]
        examples.append(example_of(shown, speed, parameters.denoise, platform))
    return tuple(examples)


def example_of(
    shown: KnownPass, speed: float, denoise: DenoiseParameters, platform: Platform | None = None
) -> Example:
    """Return the signals of a pass, which must have no faults. `speed` is the nominal speed in m/s.

    The signal without noise is computed only if the platform of the machine is given.
    """
    window, rate = shown.window, shown.window.sample_rate
    t1, t2, t3 = (
        seconds((stamp or 0) - window.stamp) for stamp in (window.t1, window.t2, window.t3)
    )
    first = max(int(t1 * rate - _LEAD * rate), window.empty_begin, 0)
    on, full, off = (time - first / rate for time in (t1, t2, t3))
    signal = window.force[first:]
    ideal: NDArray[np.float64] = np.zeros(0)
    if platform is not None:
        crossing = Crossing(on, full, off, off + full - on)
        time = np.arange(len(signal)) / rate
        ideal = shown.mass * responses(platform, shown.mass, crossing, time)[0]
    return Example(
        speed,
        shown.mass,
        rate,
        t1=on,
        t2=full,
        t3=off,
        t4=off + full - on,
        signal=signal,
        ideal=ideal,
        denoised=tuple((method, _denoised(window, denoise, method)) for method in METHODS),
        bands=_bands(signal),
    )


def _denoised(window: WeighWindow, denoise: DenoiseParameters, method: str) -> NDArray[np.float64]:
    clean = Denoiser(replace(denoise, method=method)).denoise(window).denoised
    return clean[window.window_begin : window.window_end]


def _bands(signal: NDArray[np.float64]) -> tuple[tuple[str, NDArray[np.float64]], ...]:
    """Return the name and the signal, (n,), of each band of the stationary wavelet transform.

    The sum of the signals of all bands is `signal`, (n,).
    """
    period = 2**LEVELS
    room = -len(signal) % period + 4 * period
    padded = np.pad(signal, (room // 2, room - room // 2), 'symmetric')
    parts = pywt.mra(padded, WAVELET, level=LEVELS, transform='swt')
    names = (f'a{LEVELS}', *(f'd{level}' for level in range(LEVELS, 0, -1)))
    kept = slice(room // 2, room // 2 + len(signal))
    return tuple((name, part[kept]) for name, part in zip(names, parts, strict=True))
