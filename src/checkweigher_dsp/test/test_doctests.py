# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The examples in the docstrings of kernels and estimators."""

from dataclasses import replace
import doctest
from importlib import import_module
from pkgutil import walk_packages

import numpy as np
import pytest
from synthetic_line import make_window

import checkweigher_dsp

ROOMS = ('signal', 'denoising', 'estimation')
# Each kernel or estimator of these modules shows an example.
WITH_EXAMPLES = {
    'denoising.entry_fit', 'denoising.extrapolation', 'denoising.load_rise',
    'denoising.shrinkage_table', 'denoising.wavelet_shrinkage', 'estimation.estimators.aeksi',
    'estimation.estimators.aid', 'estimation.estimators.averages',
    'estimation.estimators.fir_model', 'estimation.estimators.gauss_markov',
    'estimation.estimators.iswd_eksi', 'estimation.estimators.tvlpf', 'estimation.identifier',
    'signal.autoregression', 'signal.averages', 'signal.extended_kalman',
    'signal.platform_response', 'signal.prewhitening',
}  # fmt: skip
MODULES = sorted(
    found.name.removeprefix('checkweigher_dsp.')
    for room in ROOMS
    for found in walk_packages(
        [f'{checkweigher_dsp.__path__[0]}/{room}'], f'checkweigher_dsp.{room}.'
    )
)


def test_the_modules_with_examples_exist():
    assert set(MODULES) >= WITH_EXAMPLES


@pytest.mark.parametrize('name', MODULES)
def test_the_examples_of_a_module_are_true(name):
    window = replace(make_window([0.2] * 96), denoised=np.full(96, 0.2))

    result = doctest.testmod(
        import_module(f'checkweigher_dsp.{name}'), extraglobs={'window': window}
    )

    assert result.failed == 0
    assert result.attempted > 0 or name not in WITH_EXAMPLES
