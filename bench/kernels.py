# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The kernels of ISWD-EKSI against PyWavelets and filterpy, on the windows of the bags."""

import os

# Matrices as small as these are slower on several threads; set before numpy reads it.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from measure import Case, main
import numpy as np
import plain_path

from checkweigher_core.records import Reference, WeighWindow
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.denoising.wavelet_shrinkage import denoise_periodic
from checkweigher_dsp.denoising.window_batch import denoised_pass
from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksiParameters, identify_passes
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_recording.bags.reading import read_bag

BAGS = Path(__file__).parent.parent / 'bags'
KNOWN = IswdEksiParameters()
_BATCH = 256
_TARGETS = {30: 20.0, 90: 30.0}
# Table 1 in a unit that leaves something of each band: with thresholds, unlike the default table.
_COLUMNS = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
THRESHOLDS = DenoiseParameters(
    threshold_unit=1e-6, **dict(zip(_COLUMNS, (*TABLE_1.gains, *TABLE_1.thresholds), strict=True))
)


def windows_of(speed: int) -> list[WeighWindow]:
    """Return the whole windows of the bag of a belt speed in m/min."""
    recording = read_bag(BAGS / f'paper_{speed}')
    segmenter = Segmenter(recording.load_cell, SegmenterParameters())
    windows: list[WeighWindow] = []
    for event in recording:
        if not isinstance(event, Reference):
            windows += segmenter.take(event)
    return [window for window in windows + segmenter.finish() if not window.reasons]


def kernel_cases(speed: int) -> list[Case]:
    """Return shrinkage and identification of one window, with and without thresholds."""
    window = Denoiser(DenoiseParameters()).denoise(windows_of(speed)[0])
    denoised, share = denoised_pass(window)
    removed = np.var(raw_samples(window) - denoised[-len(raw_samples(window)) :])
    rise = KNOWN.rise_noise[0]
    identify = partial(identify_passes, [(denoised, share)], np.array([removed]), KNOWN.noise, rise)
    identify_plainly = partial(
        plain_path.identify_window, denoised, removed, share, KNOWN.noise, rise
    )
    length = DenoiseParameters().stretch
    stretch = np.resize(window.force_between(0, window.window_end), length)
    cases = []
    for name, parameters in (('', DenoiseParameters()), (', thresholds', THRESHOLDS)):
        details = parameters.table.at(window.belt_speed, parameters.threshold_unit)
        shrink = partial(denoise_periodic, stretch, details)
        shrink_plainly = partial(plain_path.denoise_periodic, stretch, details)

        def kernels(shrink=shrink) -> None:
            shrink()
            identify()

        def plainly(shrink_plainly=shrink_plainly) -> None:
            shrink_plainly()
            identify_plainly()

        cases += [
            Case(f'kernels {speed} m/min{name}', kernels, plainly, target=_TARGETS[speed]),
            Case(f'shrinkage {speed} m/min{name}', shrink, shrink_plainly),
        ]
    return [*cases, Case(f'identification {speed} m/min', identify, identify_plainly)]


def varied(windows: list[WeighWindow], count: int, seed: int = 1) -> list[WeighWindow]:
    """Return as many windows, no two of them alike, but of as many shapes as in a recording."""
    random = np.random.default_rng(seed)
    return [
        replace(window, counts=window.counts + random.integers(-99, 99, len(window.counts)))
        for window in (windows * (count // len(windows) + 1))[:count]
    ]


def window_cases(speed: int) -> list[Case]:
    """Return a whole window, from counts to mass: one, and each of many at once."""
    windows = windows_of(speed)
    many = varied(windows, _BATCH)
    cases = []
    for name, parameters in (('', DenoiseParameters()), (', thresholds', THRESHOLDS)):
        denoiser, identifier = Denoiser(parameters), Identifier(IdentifierParameters())

        def one(denoiser=denoiser, identifier=identifier) -> None:
            identifier.estimate(denoiser.denoise(windows[0]))

        def batch(denoiser=denoiser, identifier=identifier) -> None:
            identifier.estimate_all(denoiser.denoise_all(many))

        plainly = partial(plain_path.weigh_window, windows[0], parameters, KNOWN)
        cases += [
            Case(f'window {speed} m/min{name}', one, plainly),
            Case(f'window of a batch {speed} m/min{name}', batch, one, count=_BATCH),
        ]
    identifier = Identifier(replace(IdentifierParameters(), estimator='gauss_markov'))
    cases.append(
        Case(f'gauss_markov {speed} m/min', partial(identifier.estimate, windows[0]), plainly)
    )
    return cases


def make_cases() -> Sequence[Case]:
    """Return all cases."""
    return [
        case for speed in _TARGETS for make in (kernel_cases, window_cases) for case in make(speed)
    ]


if __name__ == '__main__':
    main('Kernels of ISWD-EKSI as a ratio to PyWavelets and filterpy.', make_cases)
