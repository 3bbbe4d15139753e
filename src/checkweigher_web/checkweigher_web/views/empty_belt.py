# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""View of the spectrum of the empty belt, with its strongest lines and their possible causes."""

from dataclasses import dataclass
import math
import time

from nicegui import json
import numpy as np
from numpy.typing import NDArray

from checkweigher_web import charts
from checkweigher_web.charts import DENOISED, Options
from checkweigher_web.elements import Figure, Table
from checkweigher_web.languages.language import ENGLISH, Language, Text
from checkweigher_web.views.view import View

_LEAST = 128  # minimum number of samples for a spectrum
_PROMINENCE = 4.0  # minimum amplitude of a line, relative to the median of the bins around it
_SURROUNDING = 10  # number of bins on each side of a line for the median of the amplitudes
_MAX_LINES = 6
# Mains may cause a line if the frequency of the line differs from a mains frequency by at most the
# fraction `_NEAR`. The platform may cause a line if the frequency of the line differs from the
# natural frequency of the platform by at most the fraction `_PLATFORM`.
_NEAR, _PLATFORM = 0.02, 0.15
_FLOOR = 12.0  # highest frequency of building vibrations in Hz
_MAINS = (50.0, 60.0, 100.0, 120.0)  # mains frequencies and their second harmonics in Hz
_HIGHEST = 150.0  # highest frequency in the figure in Hz


@dataclass(frozen=True, slots=True)
class SpectralLine:
    """Spectral line of the empty belt, with its possible cause."""

    frequency: float  # Hz
    amplitude: float  # kg
    guess: Text  # possible cause, as a text for the user


@dataclass(frozen=True, slots=True)
class Spectrum:
    """Amplitudes (n,) in kg of sines with the `frequencies` (n,) in Hz, and the strongest lines."""

    frequencies: NDArray[np.float64]
    amplitudes: NDArray[np.float64]
    lines: tuple[SpectralLine, ...]


class EmptyBeltView(View):
    """Spectrum of the empty belt, and a table of its strongest lines."""

    title = Text('Empty belt')
    columns = 1, 7

    def _build(self) -> None:
        self._figure = Figure(self.say('spectrum of the empty belt'), self.say)
        self._lines = Table(('Hz', self.say.unit, self.say('what it might be')))

    def _state(self) -> object:
        if self.look.board is not None:
            return int(time.monotonic())
        return self.lane.version, self.look.chosen

    def _show(self) -> None:
        if self.lane.load_cell is None:
            return
        figure, lines = self.drawing.once(('belt', self.say), self._state(), self._draw)
        self._figure.show_text(figure)
        self._lines.show(
            (
                self.say.number(each.frequency, 1),
                self.say.amount(each.amplitude),
                self.say(each.guess),
            )
            for each in lines
        )

    def _draw(self) -> tuple[str, tuple[SpectralLine, ...]]:
        item, cell = self.look.item(), self.lane.load_cell
        assert cell is not None
        known = None if item is None else item.estimate
        of_item = () if known is None else (known.belt_speed, known.natural_frequency)
        found = spectrum(self.lane.empty_belt(item), cell.sample_rate, *of_item)
        return json.dumps(spectrum_chart(found, self.say)), found.lines if found else ()


def spectrum_chart(found: Spectrum | None, say: Language = ENGLISH) -> Options:
    """Return the figure of a spectrum with its lines marked.

    If `found` is None, the figure contains only a text.
    """
    if found is None:
        return charts.nothing(say('needs a stretch of the empty belt'))
    shown = found.frequencies <= _HIGHEST
    amplitudes = say.per_kg * found.amplitudes[shown]
    line = charts.line(say('amplitude'), found.frequencies[shown], amplitudes, DENOISED, width=1)
    figure = charts.figure([line], 'Hz', say.unit)
    figure['xAxis'] |= {'min': 0, 'max': min(_HIGHEST, float(found.frequencies[-1]))}
    charts.mark_apart(figure, {f'{each.frequency:.0f}': each.frequency for each in found.lines})
    return figure


def spectrum(
    force: NDArray[np.float64],
    sample_rate: float,
    belt_speed: float = math.nan,
    platform: float = math.nan,
) -> Spectrum | None:
    """Compute the spectrum of the empty belt, or return None for fewer than `_LEAST` samples.

    The samples `force` (n,) are in kg, and `sample_rate` is in Hz. `belt_speed` in m/s determines
    the diameter of a roller that may cause a line. `platform` is the natural frequency of the
    weighing platform in Hz. An unknown belt speed or natural frequency is NaN, and is then not
    used.
    """
    count = len(force)
    if count < _LEAST:
        return None
    taper = np.hanning(count)
    transform = np.fft.rfft((force - force.mean()) * taper)
    amplitudes: NDArray[np.float64] = 2 * np.abs(transform) / taper.sum()
    frequencies = np.asarray(np.fft.rfftfreq(count, 1 / sample_rate), np.float64)
    peaks = [
        k
        for k in range(3, len(amplitudes) - 1)
        if amplitudes[k] == amplitudes[k - 1 : k + 2].max()
        and amplitudes[k] > _PROMINENCE * _surrounding(amplitudes, k)
    ]
    strongest = sorted(sorted(peaks, key=lambda k: -amplitudes[k])[:_MAX_LINES])
    found = zip(frequencies[strongest].tolist(), amplitudes[strongest].tolist(), strict=True)
    lines = (SpectralLine(each, size, _guess(each, belt_speed, platform)) for each, size in found)
    return Spectrum(frequencies, amplitudes, tuple(lines))


def _surrounding(amplitudes: NDArray[np.float64], k: int) -> float:
    return float(np.median(amplitudes[max(k - _SURROUNDING, 1) : k + _SURROUNDING + 1]))


def _guess(frequency: float, belt_speed: float, platform: float) -> Text:
    """Return the possible cause of a line at a frequency in Hz, as a text for the user."""
    mains = [known for known in _MAINS if abs(frequency - known) <= _NEAR * known]
    if mains:
        return Text(
            'mains or a motor at {frequency} Hz: check the shield of the cable',
            frequency=round(mains[0]),
        )
    if abs(frequency - platform) <= _PLATFORM * platform:
        return Text(
            'the platform itself, whose natural frequency is about {frequency} Hz',
            frequency=round(platform),
        )
    guess = Text('floor or building') if frequency < _FLOOR else Text('motor or roller')
    if belt_speed > 0:
        diameter = 1000 * belt_speed / (math.pi * frequency)
        return Text(
            '{guess}; a roller of {diameter} mm turns at this rate, {double} mm at half',
            guess=guess,
            diameter=round(diameter),
            double=round(2 * diameter),
        )
    return guess
