# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Figures of the signal of a pass, its spectrum, its wavelet bands and the denoised window."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import GRAMS
from checkweigher_validation.accuracy.examples import Example
from checkweigher_validation.report import inline_svg as svg

MILLISECONDS = 1000.0  # milliseconds in a second.

# Numbers of the series whose colours do not belong to an estimator.
SIGNAL, HARD, SOFT, SHRINKAGE = 90, 91, 92, 93
_THRESHOLDINGS = {'hard': HARD, 'soft': SOFT, 'shrinkage': SHRINKAGE}

_SPECTRUM_LIMIT = 120.0  # highest frequency in the figure of the spectrum, in Hz
_SPECTRUM_POINTS = 8192  # smallest FFT length
_ENERGY_SHARE = 0.99  # fraction of the energy below the frequency that the figure marks.

# Coordinates of a note at the upper edge of a diagram, with an offset in points.
_AT_TOP: Any = {'xycoords': ('data', 'axes fraction'), 'textcoords': 'offset points'}


def pass_figure(example: Example) -> Figure:
    """Draw a pass with the times t1 to t4 (figure 2 of Long et al.)."""
    figure, axes = svg.new_figure(3.0)
    _draw_pass(axes, example)
    axes.plot(_time(example), GRAMS * example.signal, color=svg.stand_in(SIGNAL), lw=1.0)
    return figure


def ideal_figure(example: Example) -> Figure:
    """Draw a pass and the response of the platform without noise (figure 5 of Long et al.)."""
    figure, (top, bottom) = svg.new_figure(4.0, 2, sharex=True, height_ratios=(3, 1))
    time = _time(example)
    _draw_pass(top, example)
    top.plot(time, GRAMS * example.signal, color=svg.stand_in(SIGNAL), lw=1.0, label='signal')
    top.plot(time, GRAMS * example.ideal, color=svg.INK, lw=1.2, label='without noise')
    top.legend(loc='upper left')
    top.set_xlabel('')
    _draw_window(bottom, example)
    bottom.plot(time, GRAMS * (example.signal - example.ideal), color=svg.stand_in(SIGNAL), lw=1.0)
    bottom.set(xlabel='time from t1, ms', ylabel='difference, g', xmargin=0)
    figure.align_ylabels()
    return figure


def spectrum_figure(example: Example) -> Figure:
    """Draw the amplitude spectra of a pass and its noise-free signal (figure 6 of Long et al.)."""
    figure, axes = svg.new_figure(3.0)
    frequency, amplitude = amplitude_spectrum(example.signal, example.sample_rate)
    axes.semilogy(frequency, GRAMS * amplitude, color=svg.stand_in(SIGNAL), lw=1.0, label='signal')
    if len(example.ideal):
        _, of_ideal = amplitude_spectrum(example.ideal, example.sample_rate)
        axes.semilogy(frequency, GRAMS * of_ideal, color=svg.INK, lw=1.2, label='without noise')
        limit = energy_limit(example)
        axes.axvline(limit, **svg.DOTTED)
        text = f'{100 * _ENERGY_SHARE:.0f} % of the energy\nbelow {limit:.1f} Hz'
        axes.annotate(text, (limit, 1), (5, -3), **_AT_TOP, color=svg.MUTED, fontsize=8, va='top')
    top = GRAMS * amplitude.max()
    axes.set(xlim=(0, _SPECTRUM_LIMIT), ylim=(top / 3e4, top * 1.5))
    axes.set(xlabel='frequency, Hz', ylabel='amplitude, g/Hz')
    axes.yaxis.set_major_formatter('{x:g}')
    axes.legend(loc='upper right')
    return figure


def bands_figure(example: Example) -> Figure:
    """Draw the bands of the stationary wavelet transform (figure 7 of Long et al.)."""
    count = len(example.bands)
    figure, grid = svg.new_figure(0.62 * count + 0.5, count, sharex=True, squeeze=False)
    for axes, (name, values) in zip(grid[:, 0], example.bands, strict=True):
        axes.plot(_time(example), GRAMS * values, color=svg.stand_in(SIGNAL), lw=0.9)
        _draw_window(axes, example)
        axes.set_ylabel(name, rotation=0, ha='right', va='center', color=svg.INK)
        axes.locator_params(axis='y', nbins=3)
        axes.margins(x=0)
    figure.align_ylabels()
    grid[-1, 0].set_xlabel('time from t1, ms')
    figure.supylabel('g', fontsize=9, color=svg.MUTED)
    return figure


def denoised_figure(example: Example) -> Figure:
    """Draw the weighing window after each kind of thresholding (figures 8, 9 of Long et al.)."""
    figure, axes = svg.new_figure(3.4)
    window = example.window
    time = _time(example)[window]
    axes.plot(
        time, GRAMS * example.signal[window], color=svg.MUTED, lw=0.8, label='signal', zorder=1
    )
    if len(example.ideal):
        axes.plot(time, GRAMS * example.ideal[window], color=svg.INK, lw=1.2, label='without noise')
    for number, (name, values) in enumerate(example.denoised):
        color = svg.stand_in(_THRESHOLDINGS.get(name, SIGNAL + number))
        axes.plot(time, GRAMS * values, color=color, lw=1.6, label=name)
    axes.axhline(GRAMS * example.mass, **svg.DOTTED, label='true mass')
    axes.set(xlabel='time from t1, ms', ylabel='g', xmargin=0)
    axes.legend(loc='lower left', bbox_to_anchor=(0, 1), ncols=6, borderpad=0)
    return figure


def amplitude_spectrum(
    signal: NDArray[np.float64], sample_rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the frequencies, (m,), and the amplitude spectrum, (m,), of a signal, (n,).

    A signal of fewer than `_SPECTRUM_POINTS` samples is padded with zeros to this length, so that
    the spectrum is smooth. Because of the zeros, the signal should begin and end near zero.
    `sample_rate` and the frequencies are in Hz. The amplitude is the magnitude of the Fourier
    transform, in the unit of the signal per Hz.
    """
    points = max(_SPECTRUM_POINTS, len(signal))
    frequency = np.fft.rfftfreq(points, 1 / sample_rate)
    amplitude = np.abs(np.fft.rfft(signal, points)) / sample_rate
    return np.asarray(frequency, np.float64), np.asarray(amplitude, np.float64)


def energy_limit(example: Example) -> float:
    """Return the frequency in Hz below which the noise-free signal has 99 % of its energy."""
    frequency, amplitude = amplitude_spectrum(example.ideal, example.sample_rate)
    energy = np.cumsum(amplitude**2)
    return float(frequency[np.searchsorted(energy, _ENERGY_SHARE * energy[-1])])


def _draw_pass(axes: Axes, example: Example) -> None:
    _draw_window(axes, example)
    for name in ('t1', 't2', 't3', 't4'):
        time = MILLISECONDS * (getattr(example, name) - example.t1)
        axes.axvline(time, **svg.DOTTED)
        axes.annotate(name, (time, 1), (0, 3), **_AT_TOP, ha='center', color=svg.INK)
    axes.set(xlabel='time from t1, ms', ylabel='g', xmargin=0)


def _draw_window(axes: Axes, example: Example) -> None:
    begin, end = (MILLISECONDS * (time - example.t1) for time in (example.t2, example.t3))
    axes.axvspan(begin, end, color=svg.SHADE, lw=0)


def _time(example: Example) -> NDArray[np.float64]:
    index = np.arange(len(example.signal))
    return np.asarray(MILLISECONDS * (index / example.sample_rate - example.t1), np.float64)
