# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The padding of a window, its denoising, and the windows that are refused."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from synthetic_line import make_window

from checkweigher_core.records import NANOSECONDS, WeighWindow
from checkweigher_dsp.denoising.denoiser import PADDINGS, DenoiseParameters, Denoiser, pad
from checkweigher_dsp.denoising.load_rise import load_response
from checkweigher_dsp.denoising.shrinkage_table import TABLE_1
from checkweigher_dsp.denoising.wavelet_shrinkage import (
    Shrinkage,
    denoise_periodic,
    threshold_universally,
)
from checkweigher_dsp.denoising.window_batch import batches_of, denoised_pass

ROUNDING = 1e-12
RATE = 960.0


def _table_1(**values):
    """Parameters with Table 1 on a stretch that is filled with the level."""
    names = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
    table = dict(zip(names, (*TABLE_1.gains, *TABLE_1.thresholds), strict=True))
    return DenoiseParameters(**{'surround': 'level', **table, **values})


def _make_pass(mass=0.2, disturbance=None, stamp_of_t1=0.3004, rise=0.1, stay=0.1):
    """Return the window of a product on a platform of 38 Hz, damping ratio 0.06 and 2.5 kg."""
    times = np.arange(math.ceil((stamp_of_t1 + rise + stay) * RATE)) / RATE
    ease = math.sqrt(2.5 / (2.5 + mass))
    force = mass * load_response(times - stamp_of_t1, rise, 38.0 * ease, 0.06 * ease)
    if disturbance is not None:
        force = force + disturbance(times)
    t1, t2, t3 = (round(NANOSECONDS * (stamp_of_t1 + t)) for t in (0, rise, rise + stay))
    begin = math.ceil((stamp_of_t1 + rise) * RATE)
    return make_window(
        force, counts_per_kg=1e9, zero=0.0, t1=t1, t2=t2, t3=t3, stamp=0, window_begin=begin,
    )  # fmt: skip


def _noisy(count, seed=1):
    return 0.2 + 0.01 * np.random.default_rng(seed).standard_normal(count)


@pytest.mark.parametrize(
    ('count', 'min_length', 'length'),
    [(3, 128, 128), (64, 128, 128), (65, 128, 256), (3, 129, 256), (100, 1000, 1024)],
)
def test_the_padded_length_is_the_next_multiple_of_128(count, min_length, length):
    samples = np.arange(1.0, count + 1)

    padded, offset = pad(samples, min_length)

    assert len(padded) == length
    assert offset == (length - count) // 2
    np.testing.assert_array_equal(padded[offset : offset + count], samples)
    # The Hann-weighted mean of a ramp is its middle.
    outside = np.r_[padded[:offset], padded[offset + count :]]
    np.testing.assert_allclose(outside, (count + 1) / 2, rtol=ROUNDING)


def test_the_window_is_denoised_with_the_shrinkage_of_its_speed():
    window = make_window(_noisy(96), lead=50, belt_speed=1.125)
    unit = 2e-6
    # Table 1 half-way between 60 and 75 m/min.
    details = [None] * 4 + [
        Shrinkage(0.095, 285 * unit), Shrinkage(0.5515, 33 * unit), Shrinkage(0.8225, 4 * unit)
    ]  # fmt: skip
    padded, offset = pad((window.counts[50:] - 5000.0) / 1e6, 512)

    denoised = Denoiser(_table_1(threshold_unit=unit, stretch=512)).denoise(window)

    assert np.isnan(denoised.denoised[:50]).all()
    np.testing.assert_allclose(
        denoised.denoised[50:],
        denoise_periodic(padded, details)[offset : offset + 96],
        rtol=ROUNDING,
    )
    assert replace(denoised, denoised=np.zeros(0)) == window


# With continuation the platform that is reckoned with depends on the mass.
@pytest.mark.parametrize('way', ['level', 'mirror', 'signal'])
@given(factor=st.floats(0.01, 100.0))
def test_with_thresholds_of_0_denoising_scales_with_the_signal(way, factor):
    force = _noisy(96)
    denoiser = Denoiser(_table_1(threshold_unit=0.0, surround=way))
    plain = denoiser.denoise(make_window(force, counts_per_kg=1e7, zero=0.0))
    scaled = denoiser.denoise(replace(plain, counts_per_kg=1e7 / factor))
    np.testing.assert_allclose(scaled.denoised, factor * plain.denoised, rtol=1e-9)


@pytest.mark.parametrize('way', ['level', 'mirror', 'signal'])
def test_a_constant_window_stays_as_it_is(way):
    denoised = Denoiser(DenoiseParameters(surround=way)).denoise(make_window([0.25] * 64))
    np.testing.assert_allclose(denoised.denoised, 0.25, rtol=ROUNDING)


@pytest.mark.parametrize(('rise', 'stay'), [(0.1, 0.1), (0.067, 0.067), (0.2, 0.2), (0.05, 0.3)])
def test_a_pass_without_disturbance_becomes_its_load(rise, stay):
    # What is left is the rounding of the counts, 1e-9 kg, and a level that is found from the
    # ringing window: each time a small share of its error remains.
    window = _make_pass(rise=rise, stay=stay)

    denoised, share = denoised_pass(Denoiser(DenoiseParameters(iterations=20)).denoise(window))

    np.testing.assert_allclose(denoised, 0.2 * share, atol=1e-6)
    assert share[-1] == 1.0
    assert 0 <= share[0] < 1 / (rise * RATE)
    assert len(share) == math.ceil((0.3004 + rise + stay) * RATE) - math.ceil(0.3004 * RATE)


def test_a_line_that_goes_on_through_the_pass_is_removed():
    # 20 Hz lies in bands 5 and 6, which are removed; 3 g are 15 times the bound.
    line = 0.003
    window = _make_pass(disturbance=lambda time: line * np.sin(2 * np.pi * 20 * time + 1))

    denoised, share = denoised_pass(Denoiser(DenoiseParameters(iterations=5)).denoise(window))

    assert np.abs(denoised - 0.2 * share).max() < line / 15


@pytest.mark.parametrize('way', PADDINGS)
def test_nothing_is_denoised_before_t1_and_without_continuation_nothing_before_t2(way):
    window = Denoiser(DenoiseParameters(surround=way)).denoise(_make_pass())

    continued = way == 'continuation'
    begin = math.ceil(0.3004 * RATE) if continued else window.window_begin
    assert np.isnan(window.denoised[:begin]).all()
    assert np.isfinite(window.denoised[begin:]).all()
    denoised, share = denoised_pass(window)
    assert len(denoised) == len(share) == window.window_end - begin
    assert continued or np.all(share == 1.0)


def test_what_the_item_before_left_does_not_matter():
    window = _make_pass()
    shaken = window.counts.copy()
    shaken[:100] += 10**7
    denoiser = Denoiser(DenoiseParameters())

    plain = denoiser.denoise(replace(window, empty_begin=100))
    result = denoiser.denoise(replace(window, counts=shaken, empty_begin=100))

    np.testing.assert_array_equal(result.denoised, plain.denoised)


@pytest.mark.parametrize('uncertain', [0.0, 1.3e-3])
@pytest.mark.parametrize('way', PADDINGS)
@pytest.mark.parametrize('method', ['shrinkage', 'soft', 'hard'])
def test_a_window_has_the_same_bits_in_any_batch(way, method, uncertain):
    random = np.random.default_rng(3)
    windows = [
        _make_pass(mass, lambda time: 1e-3 * random.standard_normal(len(time)), at, 0.1, stay)
        for mass, at, stay in ((0.1, 0.3, 0.1), (0.2, 0.3, 0.1), (0.3, 0.32, 0.12))
    ]
    windows[1] = replace(windows[1], belt_speed=0.6)
    denoiser = Denoiser(
        _table_1(surround=way, method=method, edge_uncertainty=uncertain, threshold_unit=1e-6)
    )

    assert len(batches_of(windows, 1024)) == 2
    for found, window in zip(denoiser.denoise_all(windows), windows, strict=True):
        np.testing.assert_array_equal(found.denoised, denoiser.denoise(window).denoised)


def test_soft_and_hard_thresholds_take_their_noise_from_the_window():
    window = make_window(_noisy(96))
    padded, offset = pad(window.force, 1024)
    measured = slice(offset, offset + 96)
    for method in ('soft', 'hard'):
        for each_level in (False, True):
            parameters = DenoiseParameters(method=method, each_level=each_level, surround='level')
            np.testing.assert_allclose(
                Denoiser(parameters).denoise(window).denoised,
                threshold_universally(
                    padded, hard=method == 'hard', measured=measured, each_level=each_level
                )[measured],
                rtol=ROUNDING,
            )


def test_a_fault_passes_unchanged():
    fault = WeighWindow(3, None, None, 5, reasons=('MissingEdge',))
    assert Denoiser(DenoiseParameters()).denoise(fault) is fault


@pytest.mark.parametrize(
    'fields',
    [
        {'window_begin': -1},
        {'window_begin': 40, 'window_end': 40},
        {'window_end': 1000},
        {'counts': np.zeros(0, np.int32)},
        {'counts_per_kg': 0.0},
        {'zero': math.nan},
        {'zero_counts': math.inf},
        {'zero_std_dev': math.nan},
        {'sample_rate': 0.0},
        {'belt_speed': math.inf},
    ],
    ids=str,
)
def test_a_window_that_contradicts_itself_is_a_bad_window(fields):
    window = replace(make_window(_noisy(64)), **fields)
    result = Denoiser(DenoiseParameters()).denoise(window)
    assert result.reasons == ('BadWindow',)
    assert len(result.denoised) == 0


def test_the_signal_stands_before_the_window_and_its_first_value_before_that():
    before = np.array([5.0, 6.0, 7.0])
    padded, offset = pad(np.full(100, 2.0), 256, 'signal', before)
    assert padded[offset - 5 : offset + 1].tolist() == [5, 5, 5, 6, 7, 2]
    assert padded[offset:] == pytest.approx(np.full(256 - offset, 2.0))
    longer, offset = pad(np.full(100, 2.0), 256, 'signal', np.arange(500.0))
    assert longer[: offset + 1].tolist() == [*range(500 - offset, 500), 2]
