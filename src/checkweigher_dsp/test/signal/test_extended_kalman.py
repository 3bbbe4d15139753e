"""The filter in scalars against filterpy's in matrices, and against platforms of known theory."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import plain_path
from plain_path import MatrixFilter
import pytest

from checkweigher_dsp.signal.extended_kalman import Noise, Start, identify
from checkweigher_dsp.signal.platform_poles import is_stable, platform_poles
from checkweigher_dsp.signal.window_identification import (
    WindowGroup,
    WindowNoise,
    identify_groups,
    identify_window,
)

RATE = 960.0
ROUNDING = 1e-10
PLATFORMS = [(20.0, 0.03), (38.0, 0.06), (60.0, 0.2)]  # Hz, damping ratio


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
    reference = MatrixFilter(noise)
    for sample in samples:
        reference.step(sample)
    a1, a2, b1 = reference.x[2:, 0]
    total = 1 + a1 + a2
    slope = np.array([-b1 / total**2, -b1 / total**2, 1 / total])

    result = identify(samples.tolist(), noise)

    assert (result.a1, result.a2, result.b1) == pytest.approx((a1, a2, b1), rel=ROUNDING)
    assert result.gain == pytest.approx(b1 / total, rel=ROUNDING)
    assert result.variance == pytest.approx(slope @ reference.P[2:, 2:] @ slope, rel=ROUNDING)


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(8, 200),
    st.floats(1e-8, 1.0),
    st.builds(Start, *(st.floats(-1.0, 1.0),) * 2, st.floats(-1.9, 0.0), st.floats(0.0, 0.9)),
)
def test_loads_starts_and_noises_of_each_sample_agree_with_the_matrix_form(
    seed, count, of_coefficients, start
):
    random = np.random.default_rng(seed)
    noise = Noise(1e-5, 1e-3, 0.5, of_coefficients)
    loads = np.minimum(np.arange(count) / (count / 2), 1.0)
    samples = loads + 0.1 * random.standard_normal(count)
    measurement = 1e-3 * random.uniform(0.5, 20.0, count)
    reference = MatrixFilter(noise, start)
    for values in zip(samples, loads, measurement, strict=True):
        reference.step(*values)
    a1, a2, b1 = reference.x[2:, 0]

    result = identify(
        samples.tolist(), noise, loads.tolist(), start=start, measurement=measurement.tolist()
    )

    assert (result.a1, result.a2, result.b1) == pytest.approx(
        (a1, a2, b1), rel=ROUNDING, abs=ROUNDING
    )


def test_many_signals_at_once_are_identified_as_each_alone():
    random = np.random.default_rng(5)
    samples = 1 + 0.2 * random.standard_normal((7, 60))
    loads = np.minimum(np.arange(60) / random.uniform(5, 40, (7, 1)), 1.0)
    noises = [Noise(1e-4 * k, 1e-3 * k, 1.0, 0.1) for k in range(1, 8)]
    together = Noise(
        np.array([n.process for n in noises]), np.array([n.measurement for n in noises]), 1.0, 0.1
    )

    result = identify(samples.T, together, loads.T)

    for k, noise in enumerate(noises):
        alone = identify(samples[k].tolist(), noise, loads[k].tolist())
        assert (result.gain[k], result.variance[k]) == pytest.approx(
            (alone.gain, alone.variance), rel=ROUNDING
        )
        assert (result.a1[k], result.a2[k], result.b1[k]) == pytest.approx(
            (alone.a1, alone.a2, alone.b1), rel=ROUNDING
        )


def test_a_load_that_rises_is_identified_from_its_rise():
    # Platform at rest, load known at every step: nothing is modelled wrongly.
    a1, a2 = _coefficients(38.0, 0.06)
    loads = np.minimum(np.arange(1, 129) / 64, 1.0)
    x = [0.0, 0.0]
    for load in loads:
        x.append(-a1 * x[-1] - a2 * x[-2] + 0.7 * (1 + a1 + a2) * load)

    result = identify(x[2:], Noise(0.0, 1e-12), loads.tolist())

    assert result.gain == pytest.approx(0.7, rel=1e-6)
    assert platform_poles(result.a1, result.a2, RATE) == pytest.approx((38.0, 0.06), rel=1e-4)


def test_coefficients_of_no_variance_stay_where_they_start():
    start = Start(a1=-0.5, a2=0.1)

    result = identify([0.3, 0.9, 1.1, 1.0], Noise(1e-4, 1e-3, 1.0, 0.0), start=start)

    assert (result.a1, result.a2) == (-0.5, 0.1)


def test_a_window_without_platform_is_weighed_by_least_squares():
    # With a1 = a2 = 0 known the model is z = b1 u + noise; x, which is predicted anew at each
    # step, adds its Q to R, and 1 / P0 is the weight of the prior.
    loads = np.minimum(np.arange(1, 91) / 45, 1.0)
    samples = 0.2 * loads + 0.01 * np.random.default_rng(6).standard_normal(90)
    noise = WindowNoise(0.5, 0.2, 1.0, 0.0, rise=4.0)
    scale = np.mean(samples[44:])
    total = 0.5 * 1e-4 / scale**2 * np.where(loads < 1, 4.0 + 0.2, 1.0 + 0.2)
    normal = np.sum(loads**2 / total) + 1 / noise.initial

    result = identify_window(samples, 1e-4, loads, noise)

    expected = np.sum(loads * samples / total) / normal
    assert result.gain == pytest.approx(expected, rel=ROUNDING)
    assert result.b1 == pytest.approx(expected, rel=ROUNDING)
    assert result.variance == pytest.approx(scale**2 / normal, rel=ROUNDING)


@settings(max_examples=25)
@given(
    st.integers(0, 2**32 - 1),
    st.integers(16, 200),
    st.floats(0.05, 0.9),
    st.builds(
        WindowNoise, st.floats(1e-3, 10.0), st.floats(0.0, 1.0), st.floats(0.01, 10.0),
        st.floats(1e-8, 1e-2), st.floats(1.0, 1e3),
    ),
)  # fmt: skip
def test_windows_agree_with_filterpy(seed, count, rise, noise):
    random = np.random.default_rng(seed)
    loads = np.minimum(np.arange(1, count + 1) / (rise * count), 1.0)
    samples = 0.2 * loads + 0.01 * random.standard_normal(count)

    found = identify_window(samples, 1e-4, loads, noise)

    expected = plain_path.identify_window(samples, 1e-4, loads, noise)
    assert (found.gain, found.variance) == pytest.approx(expected, rel=ROUNDING)


@pytest.mark.parametrize('count', [1, 31, 40])  # few of them are identified one by one
def test_windows_at_once_have_the_same_bits_as_each_alone(count):
    random = np.random.default_rng(9)
    loads = np.minimum(np.arange(1, 129) / random.uniform(30, 64, (count, 1)), 1.0)
    samples = 0.2 * loads + 0.01 * random.standard_normal((count, 128))
    removed, rises = random.uniform(0, 1e-4, count), random.uniform(1.0, 20.0, count)

    together = identify_window(samples, removed, loads, WindowNoise(rise=rises))

    for k in range(count):
        alone = identify_window(
            samples[k], float(removed[k]), loads[k], WindowNoise(rise=float(rises[k]))
        )
        for name in ('a1', 'a2', 'b1', 'gain', 'variance'):
            assert getattr(together, name)[k] == getattr(alone, name)


def test_windows_of_several_lengths_at_once_have_the_same_bits_as_each_alone():
    random = np.random.default_rng(10)
    groups = []
    for count, length in ((3, 100), (1, 128), (4, 99), (2, 1)):
        loads = np.minimum(np.arange(1, length + 1) / random.uniform(30, 64, (count, 1)), 1.0)
        loads[:, -1] = 1.0
        samples = 0.2 * loads + 0.01 * random.standard_normal((count, length))
        removed, rises = random.uniform(0, 1e-4, count), random.uniform(1.0, 20.0, count)
        groups.append(WindowGroup(samples, removed, loads, rises))
    groups[0].denoised[1] = math.nan

    for group, together in zip(groups, identify_groups(groups, WindowNoise()), strict=True):
        for k, samples in enumerate(group.denoised):
            noise = WindowNoise(rise=float(group.rise[k]))
            removed = float(group.removed_variance[k])
            alone = identify_window(samples, removed, group.inputs[k], noise)
            for name in ('a1', 'a2', 'b1', 'gain', 'variance'):
                assert repr(float(getattr(together, name)[k])) == repr(getattr(alone, name))


@pytest.mark.parametrize('gain', [-3.0, 1e-6, 1e6])
def test_the_unit_of_a_window_does_not_matter(gain):
    samples = 0.2 + 0.01 * np.random.default_rng(7).standard_normal(64)

    plain = identify_window(samples, 1e-4, None, WindowNoise())
    scaled = identify_window(gain * samples, gain**2 * 1e-4, None, WindowNoise())

    assert scaled.gain == pytest.approx(gain * plain.gain, rel=1e-9)
    assert scaled.variance == pytest.approx(gain**2 * plain.variance, rel=1e-9)


def test_windows_at_once_are_identified_as_each_alone():
    samples = 0.2 + 0.01 * np.random.default_rng(8).standard_normal((4, 64))
    samples[3] = np.nan
    loads = np.minimum(np.arange(1, 65) / np.array([[10], [20], [30], [40]]), 1.0)
    removed = np.array([1e-4, 2e-4, 0.0, 1e-4])

    together = identify_window(samples, removed, loads, WindowNoise())

    for k in range(3):
        alone = identify_window(samples[k], float(removed[k]), loads[k], WindowNoise())
        assert isinstance(alone.gain, float)
        assert together.gain[k] == pytest.approx(alone.gain, rel=ROUNDING)
        assert together.variance[k] == pytest.approx(alone.variance, rel=ROUNDING)
    assert math.isnan(together.gain[3])


@pytest.mark.parametrize('samples', [np.zeros(20), np.full(20, math.nan), np.full(20, math.inf)])
def test_a_window_without_a_level_has_no_gain(samples):
    assert math.isnan(identify_window(samples, 0.0, None, WindowNoise()).gain)


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
