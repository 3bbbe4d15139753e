# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Signals of a converter that lies, and signals that only look like it."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_line import make_pass, make_window

from checkweigher_dsp.denoising.window_batch import time_since_entry
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.estimation.plausibility import is_plausible

NOISE, ZERO = 5e-5, 500.0  # kg, counts


@pytest.fixture
def window():
    """Return a pass in steps of 2 mg, with the noise of the electronics."""
    random = np.random.default_rng(3)
    noisy = make_pass(0.2, disturbance=lambda time: NOISE * random.standard_normal(len(time)))
    counts = (noisy.counts // 2000 + ZERO).astype(np.int32)
    return replace(noisy, counts=counts, counts_per_kg=5e5, zero=ZERO)


def frozen(counts):
    return np.full_like(counts, counts[0])


@pytest.mark.parametrize(
    ('change', 'begin'),
    [
        pytest.param(frozen, 490, id='frozen while the load rises'),
        pytest.param(frozen, -8, id='frozen for the last samples'),
        pytest.param(lambda counts: np.minimum(counts, 90_000), 0, id='limited'),
        pytest.param(
            lambda counts: np.where(counts > 50_000, 37_500 + counts // 4, counts),
            0,
            id='limited softly',
        ),
        pytest.param(lambda counts: counts | 1 << 14, 0, id='bit stuck at 1'),
        pytest.param(lambda counts: counts & ~(1 << 10), 0, id='bit stuck at 0'),
        pytest.param(lambda counts: np.resize(counts[:20], len(counts)), 540, id='repeated buffer'),
        pytest.param(lambda counts: counts + 1000, 540, id='step of 2 g'),
        pytest.param(lambda counts: counts * 101 // 100, 540, id='step of the gain'),
        pytest.param(lambda counts: np.repeat(counts[::4], 4)[: len(counts)], 480, id='held'),
    ],
)
def test_a_signal_that_lies_is_a_fault(window, change, begin):
    counts = window.counts.astype(np.int64)
    counts[begin:] = change(counts[begin:])
    lying = replace(window, counts=counts.astype(np.int32))

    estimate = Identifier(IdentifierParameters(estimator='hann')).estimate(lying)

    assert estimate.reasons == ('BadSignal',)


@pytest.mark.parametrize(
    'change',
    [
        pytest.param(lambda counts: counts, id='as it is'),
        pytest.param(lambda counts: counts // 200, id='steps of 0.4 g hide the noise'),
        pytest.param(lambda counts: counts * 256, id='lowest bits always 0'),
        pytest.param(lambda counts: -counts, id='upside down'),
        pytest.param(lambda counts: np.convolve(counts, np.full(6, 1 / 6))[:624], id='filtered'),
    ],
)
def test_what_a_converter_may_do_is_plausible(window, change):
    assert is_plausible(replace(window, counts=np.rint(change(window.counts)).astype(np.int32)))


def test_a_scale_without_inertia_shows_where_the_slope_of_the_load_changes(window):
    time = time_since_entry(window, 0, len(window.counts))
    share = np.clip(time / time[window.window_begin], 0, 1)
    noise = 3 * np.random.default_rng(4).standard_normal(len(time))
    counts = np.rint(ZERO + 1e5 * share + noise).astype(np.int32)
    assert is_plausible(replace(window, counts=counts))


def test_without_noise_or_empty_belt_nothing_follows_from_calm(window):
    assert is_plausible(make_window([0.2] * 64))
    assert is_plausible(make_pass(0.2))
    assert is_plausible(replace(window, empty_begin=window.window_begin))


def test_a_limit_that_the_load_crosses_again_and_again_is_found(window):
    ringing = 40 * np.sin(0.4 * np.arange(len(window.counts)))
    counts = np.rint(window.counts / 30 + ringing).astype(np.int32)  # noise of 0.8 counts
    limit = int(np.quantile(counts[window.window_begin :], 0.3))
    assert is_plausible(replace(window, counts=counts, zero=ZERO / 30))
    assert not is_plausible(replace(window, counts=np.minimum(counts, limit), zero=ZERO / 30))
