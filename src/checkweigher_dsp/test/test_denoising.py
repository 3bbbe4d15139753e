"""The stretch around a window, and what a window must be to be denoised."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.denoising import (
    DenoiseParameters,
    Denoiser,
    is_consistent,
    surround,
)
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import WeighWindow
from checkweigher_dsp.wavelet_shrinkage import Shrinkage, denoise_periodic

ROUNDING = 1e-12


def _noisy(count, seed=1):
    return 0.2 + 0.01 * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize(
    ('count', 'min_length', 'length'),
    [(3, 128, 128), (64, 128, 128), (65, 128, 256), (3, 129, 256), (100, 1000, 1024)],
)
def test_the_stretch_is_the_next_multiple_of_128(count, min_length, length):
    samples = np.arange(1.0, count + 1)

    stretch, offset = surround(samples, min_length)

    assert len(stretch) == length
    assert offset == (length - count) // 2
    np.testing.assert_array_equal(stretch[offset : offset + count], samples)
    # The Hann-weighted mean of a ramp is its middle.
    outside = np.r_[stretch[:offset], stretch[offset + count :]]
    np.testing.assert_allclose(outside, (count + 1) / 2, rtol=ROUNDING)


def test_the_window_is_denoised_with_the_shrinkage_of_its_speed(make_window):
    window = make_window(_noisy(96), lead=50, belt_speed=1.125)
    unit = 2e-6
    # Table 1 half-way between 60 and 75 m/min.
    details = [None] * 4 + [
        Shrinkage(0.095, 285 * unit), Shrinkage(0.5515, 33 * unit), Shrinkage(0.8225, 4 * unit)
    ]  # fmt: skip
    stretch, offset = surround((window.counts[50:] - 5000.0) / 1e6, 512)

    denoised = Denoiser(DenoiseParameters(threshold_unit=unit, stretch=512)).denoise(window)

    assert np.isnan(denoised.denoised[:50]).all()
    np.testing.assert_allclose(
        denoised.denoised[50:],
        denoise_periodic(stretch, details)[offset : offset + 96],
        rtol=ROUNDING,
    )
    assert replace(denoised, denoised=np.zeros(0)) == window


@pytest.mark.parametrize('gain', [-3, 7, 1000])
def test_the_gain_of_the_load_cell_does_not_matter(make_window, gain):
    window = make_window(_noisy(96), lead=10)
    scaled = replace(
        window,
        counts=gain * window.counts,
        zero=gain * window.zero,
        zero_counts=gain * window.zero_counts,
        counts_per_kg=gain * window.counts_per_kg,
    )
    denoiser = Denoiser(DenoiseParameters(threshold_unit=1e-6))

    np.testing.assert_allclose(
        denoiser.denoise(scaled).denoised, denoiser.denoise(window).denoised, rtol=1e-9
    )


@given(st.floats(0.01, 100.0))
def test_with_thresholds_of_0_denoising_is_linear(make_window, factor):
    force = _noisy(96)
    denoiser = Denoiser(DenoiseParameters(threshold_unit=0.0))
    plain = denoiser.denoise(make_window(force, counts_per_kg=1e7, zero=0.0))
    scaled = denoiser.denoise(replace(plain, counts_per_kg=1e7 / factor))

    np.testing.assert_allclose(scaled.denoised, factor * plain.denoised, rtol=1e-9)


def test_a_constant_window_stays_as_it_is(make_window):
    denoised = Denoiser(DenoiseParameters()).denoise(make_window([0.25] * 64))

    np.testing.assert_allclose(denoised.denoised, 0.25, rtol=ROUNDING)


def test_a_fault_passes_unchanged():
    fault = WeighWindow(3, None, None, 5, reasons=('MissingEdge',))

    assert Denoiser(DenoiseParameters()).denoise(fault) is fault


@pytest.mark.parametrize(
    'fields',
    [
        {'window_begin': -1},
        {'window_begin': 40, 'window_end': 40},
        {'window_begin': 41, 'window_end': 40},
        {'window_end': 1000},
        {'counts': np.zeros(0, np.int32)},
        {'counts_per_kg': 0.0},
        {'counts_per_kg': math.nan},
        {'zero': math.nan},
        {'zero_counts': math.inf},
        {'zero_std_dev': math.nan},
        {'sample_rate': 0.0},
        {'sample_rate': math.nan},
        {'belt_speed': math.nan},
        {'belt_speed': -1.0},
        {'belt_speed': math.inf},
    ],
    ids=str,
)
def test_a_window_that_contradicts_itself_is_a_bad_window(make_window, fields):
    window = replace(make_window(_noisy(64)), **fields)

    result = Denoiser(DenoiseParameters()).denoise(window)

    assert result.reasons == ('BadWindow',)
    assert len(result.denoised) == 0


_NUMBERS = st.floats() | st.sampled_from([0.0, math.nan, math.inf, 1e-300, 1.0, 960.0])


@settings(max_examples=200)
@given(
    _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS, _NUMBERS,
    st.integers(-5, 300), st.integers(-5, 300), st.integers(0, 300),
)  # fmt: skip
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_no_garbage_raises(rate, per_kg, zero_counts, zero, std_dev, speed, begin, end, count):
    counts = np.random.default_rng(count).integers(-(2**31), 2**31, count).astype(np.int32)
    window = WeighWindow(
        1, 0, 1, 2, speed, 0.1, speed, rate, per_kg, zero_counts, zero, std_dev, 0, begin, end,
        counts,
    )  # fmt: skip

    result = Denoiser(DenoiseParameters(stretch=128)).denoise(window)

    if is_consistent(window):
        assert len(result.denoised) == count
    else:
        assert result.reasons == ('BadWindow',)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'gamma6': (0.1, 0.2)}, r'denoise\.speeds: 2 values for 5 speeds'),
        ({'speeds': (1.5, 1.25, 1.0, 0.75, 0.5)}, r'denoise\.speeds: speeds must ascend'),
        ({'lambda7': (1.0, 2.0, math.inf, 4.0, 5.0)}, r'denoise\.lambda7: .*finite'),
        ({'gamma5': (0.1, -0.2, 0.1, 0.1, 0.1)}, r'denoise\.gamma5: -0\.2 is not in 0\.\.10'),
    ],
)
def test_a_table_that_does_not_fit_together_is_refused(values, message):
    with pytest.raises(ParameterError, match=message):
        DenoiseParameters(**values)


def test_a_mirrored_window_is_reflected_at_its_ends():
    stretch, offset = surround(np.arange(100.0), 256, 'mirror')
    assert (len(stretch), offset) == (256, 78)
    assert stretch[offset - 3 : offset + 2].tolist() == [2, 1, 0, 0, 1]
    assert stretch[offset + 98 : offset + 103].tolist() == [98, 99, 99, 98, 97]


def test_the_signal_stands_before_the_window_and_its_first_value_before_that():
    before = np.array([5.0, 6.0, 7.0])
    stretch, offset = surround(np.full(100, 2.0), 256, 'signal', before)
    assert stretch[offset - 5 : offset + 1].tolist() == [5, 5, 5, 6, 7, 2]
    assert stretch[offset:] == pytest.approx(np.full(256 - offset, 2.0))
    longer, offset = surround(np.full(100, 2.0), 256, 'signal', np.arange(500.0))
    assert longer[: offset + 1].tolist() == [*range(500 - offset, 500), 2]
