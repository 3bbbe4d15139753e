"""The filter in scalars against filterpy's in matrices, and against platforms of known theory."""

import math

from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.identification import Noise, identify, is_stable, platform_poles

RATE = 960.0
ROUNDING = 1e-10
PLATFORMS = [(20.0, 0.03), (38.0, 0.06), (60.0, 0.2)]  # Hz, damping ratio


class _MatrixFilter(ExtendedKalmanFilter):
    """The EKF of the method on X = [x(k), x(k-1), a1, a2, b1] with u = 1."""

    def __init__(self, noise):
        super().__init__(dim_x=5, dim_z=1)
        self.x = np.zeros((5, 1))
        self.P = noise.initial * np.eye(5)
        self.Q = np.diag([noise.process, 0.0, 0.0, 0.0, 0.0])
        self.R = np.array([[noise.measurement]])
        self.H = np.array([[1.0, 0.0, 0.0, 0.0, 0.0]])

    def predict_x(self, u=0):
        x, y, a1, a2, b1 = self.x[:, 0]
        self.x = np.array([[-a1 * x - a2 * y + b1 * 1.0], [x], [a1], [a2], [b1]])

    def step(self, sample):
        x, y, a1, a2, _ = self.x[:, 0]
        self.F = np.eye(5)
        self.F[0] = [-a1, -a2, -x, -y, 1.0]
        self.F[1] = [1.0, 0.0, 0.0, 0.0, 0.0]
        self.predict()
        self.update(np.array([[sample]]), lambda _: self.H, lambda state: self.H @ state)


def _coefficients(frequency, damping):
    """Return a1 and a2 by the closed forms of the method."""
    step = 2 * math.pi * frequency / RATE
    damped = step * math.sqrt(1 - damping**2)
    return -2 * math.exp(-damping * step) * math.cos(damped), math.exp(-2 * damping * step)


def _step_response(frequency, damping, count, level=1.0):
    """Response of a platform at rest to a load that stands from the first sample on."""
    a1, a2 = _coefficients(frequency, damping)
    x = [0.0, 0.0]
    for _ in range(count):
        x.append(-a1 * x[-1] - a2 * x[-2] + level * (1 + a1 + a2))
    return x[2:]


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(8, 200),
    st.floats(1e-4, 1e-1),
    st.floats(0.0, 10.0),
    st.floats(0.1, 10.0),
)
def test_the_filter_agrees_with_the_matrix_form(seed, count, measurement, process, initial):
    noise = Noise(process * measurement, measurement, initial)
    samples = 1 + 0.2 * np.random.default_rng(seed).standard_normal(count)
    reference = _MatrixFilter(noise)
    for sample in samples:
        reference.step(sample)
    a1, a2, b1 = reference.x[2:, 0]
    total = 1 + a1 + a2
    slope = np.array([-b1 / total**2, -b1 / total**2, 1 / total])

    result = identify(samples.tolist(), noise)

    assert (result.a1, result.a2, result.b1) == pytest.approx((a1, a2, b1), rel=ROUNDING)
    assert result.gain == pytest.approx(b1 / total, rel=ROUNDING)
    assert result.variance == pytest.approx(slope @ reference.P[2:, 2:] @ slope, rel=ROUNDING)


@pytest.mark.parametrize('level', [0.5, 1.0, 2.0])
def test_a_constant_is_its_own_steady_state(level):
    # All the filter may err by is the pull of the prior, which weighs R / P0 against the samples.
    noise = Noise(process=0.0, measurement=1e-9, initial=1.0)

    result = identify([level] * 100, noise)

    assert result.gain == pytest.approx(level, rel=10 * noise.measurement / noise.initial)


@pytest.mark.parametrize(('frequency', 'damping'), PLATFORMS)
def test_the_steady_state_of_a_noise_free_step_response_is_recovered(frequency, damping):
    # The prior pulls with R / P0 against the samples; 1 + a1 + a2, by which the pull on the
    # coefficients is divided, is small for a slow platform, hence the factor.
    noise = Noise(process=0.0, measurement=1e-12, initial=1.0)
    total = 1 + sum(_coefficients(frequency, damping))

    result = identify(_step_response(frequency, damping, 192), noise)

    assert result.gain == pytest.approx(1.0, abs=10 * noise.measurement / total**2)
    assert platform_poles(result.a1, result.a2, RATE) == pytest.approx(
        (frequency, damping), rel=1e-6
    )


@pytest.mark.parametrize(('frequency', 'damping'), PLATFORMS)
def test_an_oscillation_seen_from_its_middle_is_averaged_out(frequency, damping):
    # X0 = 0 takes the first sample for b1, so the start is modelled wrongly and a part of the
    # oscillation stays in the result whatever R is: a tenth of it is the bound held here.
    amplitude = 0.3
    k = np.arange(192)
    step = 2 * math.pi * frequency / RATE
    damped = step * math.sqrt(1 - damping**2)
    samples = 1 + amplitude * np.exp(-damping * step * k) * np.cos(damped * k + 1)

    result = identify(samples.tolist(), Noise(1e-8, 1e-6))

    assert result.gain == pytest.approx(1.0, abs=0.1 * amplitude)


def test_the_prior_pulls_less_the_wider_it_is():
    samples = _step_response(38.0, 0.06, 64)

    narrow, wide = (identify(samples, Noise(0.0, 1e-4, initial)) for initial in (0.1, 10.0))

    assert abs(wide.gain - 1) < abs(narrow.gain - 1)


def test_a_signal_beyond_all_numbers_has_no_gain():
    result = identify([1e300, -1e300, 1e300, 1e300], Noise(0.0, 1e-6))

    assert math.isnan(result.gain)
    assert math.isnan(result.variance)


@given(st.floats(1.0, 400.0), st.floats(0.01, 0.9))
def test_poles_are_those_of_the_closed_forms(frequency, damping):
    a1, a2 = _coefficients(frequency, damping)

    found = platform_poles(a1, a2, RATE)

    # The arc cosine loses half the digits where the angle is small.
    assert found == pytest.approx((frequency, damping), rel=1e-6)


@pytest.mark.parametrize(
    ('a1', 'a2'),
    [
        (-1.5, 0.5),  # poles 1 and 0.5
        (-1.0, 0.24),  # 0.6 and 0.4: real, no oscillation
        (-1.0, 1.0),  # on the unit circle
        (-1.0, 1.2),  # outside
        (0.0, -0.5),  # real, of opposite sign
        (math.nan, math.nan),
    ],
)
def test_what_does_not_oscillate_or_dies_not_out_has_no_frequency(a1, a2):
    assert all(math.isnan(value) for value in platform_poles(a1, a2, RATE))


@settings(max_examples=300)
@given(st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_stability_agrees_with_the_roots(a1, a2):
    radius = np.abs(np.roots([1.0, a1, a2])).max(initial=0.0)
    # A root on the circle is found with the square root of the rounding.
    if abs(radius - 1) > 1e-6:
        assert is_stable(a1, a2) == (radius < 1)


def test_nan_is_not_stable():
    assert not is_stable(math.nan, 0.5)
    assert not is_stable(0.5, math.nan)
