# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The filter in scalars against filterpy's in matrices, and against platforms of known theory."""

from dataclasses import astuple
import math

from hypothesis import given, settings
from hypothesis import strategies as st
from known_models import RATE, coefficients
import numpy as np
from plain_path import MatrixFilter
import pytest

from checkweigher_dsp.signal.extended_kalman import Identification, Noise, identify, platform_poles

ROUNDING = 1e-10
PLATFORMS = [(20.0, 0.03), (38.0, 0.06), (60.0, 0.2)]  # Hz, damping ratio


def _step_response(frequency, damping, count, level=1.0):
    """Response of a platform at rest to a load that stands from the first sample on."""
    a1, a2 = coefficients(frequency, damping)
    x = [0.0, 0.0]
    for _ in range(count):
        x.append(-a1 * x[-1] - a2 * x[-2] + level * (1 + a1 + a2))
    return x[2:]


def _identify(samples, noise, inputs=None, **options):
    """Identify one window, whose R is ``noise.measurement``, and return floats."""
    inputs = None if inputs is None else np.array([inputs])
    found = identify(np.array([samples]), np.ones(1), noise, inputs=inputs, **options)
    return Identification(*(float(value[0]) for value in astuple(found)))


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(8, 200),
    st.floats(1e-8, 1.0),
    st.floats(0.5, 20.0),
    st.booleans(),
)
def test_loads_starts_and_noises_of_each_sample_agree_with_the_matrix_form(
    seed, count, of_coefficients, rise, from_samples
):
    random = np.random.default_rng(seed)
    noise = Noise(1e-3, 1e-2, of_coefficients, 0.5)
    loads = np.minimum(np.arange(count) / (count / 2), 1.0)
    samples = loads + 0.1 * random.standard_normal(count)
    reference = MatrixFilter(1e-3, noise)
    begin = 0
    if from_samples:
        begin = 2
        reference.x[:2, 0] = samples[1], samples[0]
        reference.P[0, 0] = reference.P[1, 1] = 1e-3
    for sample, load in zip(samples[begin:], loads[begin:], strict=True):
        reference.step(sample, load, 1e-3 * rise if load < 1 else 1e-3)
    a1, a2, b1 = reference.x[2:, 0]
    total = 1 + a1 + a2
    slope = np.array([-b1 / total**2, -b1 / total**2, 1 / total])

    result = _identify(samples, noise, loads, rise=rise, start_from_samples=from_samples)

    assert (result.a1, result.a2, result.b1) == pytest.approx(
        (a1, a2, b1), rel=ROUNDING, abs=ROUNDING
    )
    assert result.gain == pytest.approx(b1 / total, rel=ROUNDING)
    assert result.variance == pytest.approx(slope @ reference.P[2:, 2:] @ slope, rel=ROUNDING)


@pytest.mark.parametrize('from_samples', [False, True])
def test_a_window_has_the_same_bits_in_any_batch(from_samples):
    # Windows of several lengths, one of them without a number.
    random = np.random.default_rng(5)
    samples = 1 + 0.2 * random.standard_normal((7, 60))
    samples[3] = math.nan
    loads = np.minimum(np.arange(60) / random.uniform(5, 40, (7, 1)), 1.0)
    variances, rises = random.uniform(0.0, 0.1, 7), random.uniform(1.0, 20.0, 7)
    counts = np.array([60, 58, 60, 60, 30, 58, 59])
    noise = Noise(1e-1, 1e-1, 1e-1)

    together = identify(
        samples, variances, noise, inputs=loads, counts=counts, rise=rises,
        start_from_samples=from_samples,
    )  # fmt: skip

    for k, count in enumerate(counts):
        alone = identify(
            samples[[k], :count], variances[[k]], noise, inputs=loads[[k], :count],
            rise=rises[[k]], start_from_samples=from_samples,
        )  # fmt: skip
        for name in ('a1', 'a2', 'b1', 'gain', 'variance'):
            assert repr(getattr(together, name)[k]) == repr(getattr(alone, name)[0])


@pytest.mark.parametrize(('frequency', 'damping'), PLATFORMS)
def test_the_steady_state_of_a_noise_free_step_response_is_recovered(frequency, damping):
    # The prior pulls with R / P0 against the samples; 1 + a1 + a2, by which the pull on the
    # coefficients is divided, is small for a slow platform, hence the factor.
    noise = Noise(process=0.0, measurement=1e-12, coefficients=1.0)
    total = 1 + sum(coefficients(frequency, damping))

    result = _identify(_step_response(frequency, damping, 192), noise)

    assert result.gain == pytest.approx(1.0, abs=10 * noise.measurement / total**2)
    assert platform_poles(result.a1, result.a2, RATE) == pytest.approx(
        (frequency, damping), rel=1e-6
    )


def test_a_signal_beyond_all_numbers_has_no_gain():
    result = _identify([1e300, -1e300, 1e300, 1e300], Noise(1e-6, 0.0, 1.0))
    assert math.isnan(result.gain)
    assert math.isnan(result.variance)
