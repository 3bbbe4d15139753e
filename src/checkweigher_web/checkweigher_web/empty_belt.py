# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The spectrum of the empty belt, its strongest lines and what they might be."""

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

_LEAST = 128  # samples
_PROMINENCE = 4.0  # times the median of the spectrum around a line
_SURROUNDING = 10  # bins at each side
_MAX_LINES = 6
_FLOOR = 12.0  # Hz, below it buildings vibrate
_MAINS = (50.0, 60.0, 100.0, 120.0)  # Hz
_NEAR, _PLATFORM = 0.02, 0.15  # relative


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the spectrum."""

    frequency: float  # Hz
    amplitude: float  # kg
    guess: str


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes (n,) in kg of the sines at `frequencies` (n,) in Hz, and the strongest lines."""

    frequencies: NDArray[np.float64]
    amplitudes: NDArray[np.float64]
    lines: tuple[Line, ...]


def spectrum(
    force: NDArray[np.float64], sample_rate: float, belt_speed: float = math.nan,
    platform: float = math.nan,
) -> Spectrum | None:  # fmt: skip
    """Return the spectrum of a stretch (n,) in kg, or None if it is too short.

    `sample_rate` is in Hz. With the belt speed in m/s and the natural frequency of the platform in
    Hz the lines are named after them.
    """
    count = len(force)
    if count < _LEAST:
        return None
    taper = np.hanning(count)
    amplitudes: NDArray[np.float64] = (
        2 * np.abs(np.fft.rfft((force - force.mean()) * taper)) / taper.sum()
    )
    frequencies = np.asarray(np.fft.rfftfreq(count, 1 / sample_rate), np.float64)
    peaks = [
        k
        for k in range(3, len(amplitudes) - 1)
        if amplitudes[k] == amplitudes[k - 1 : k + 2].max()
        and amplitudes[k] > _PROMINENCE * _surrounding(amplitudes, k)
    ]
    strongest = sorted(peaks, key=lambda k: -amplitudes[k])[:_MAX_LINES]
    lines = [
        Line(frequency, float(amplitudes[k]), _guess(frequency, belt_speed, platform))
        for k, frequency in ((k, float(frequencies[k])) for k in sorted(strongest))
    ]
    return Spectrum(frequencies, amplitudes, tuple(lines))


def _surrounding(amplitudes: NDArray[np.float64], k: int) -> float:
    return float(np.median(amplitudes[max(k - _SURROUNDING, 1) : k + _SURROUNDING + 1]))


def _guess(frequency: float, belt_speed: float, platform: float) -> str:
    """Return what a line might be: nothing here is measured but its frequency."""
    mains = [known for known in _MAINS if abs(frequency - known) <= _NEAR * known]
    if mains:
        return f'mains or a motor at {mains[0]:g} Hz: check the shield of the cable'
    if abs(frequency - platform) <= _PLATFORM * platform:
        return f'the platform itself, whose natural frequency is about {platform:.0f} Hz'
    guess = 'floor or building' if frequency < _FLOOR else 'motor or roller'
    if belt_speed > 0:
        diameter = 1000 * belt_speed / (math.pi * frequency)
        guess += (
            f'; a roller of {diameter:.0f} mm turns at this rate, {2 * diameter:.0f} mm at half'
        )
    return guess
