# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Times of entry against an independent least-squares solution, and on passes that know theirs."""

from dataclasses import replace
import math

import numpy as np
import pytest
from scipy.signal import lfilter
from synthetic_line import make_window

from checkweigher_core.records import NANOSECONDS
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.denoising.entry_fit import EntryFit
from checkweigher_dsp.denoising.extrapolation import block_means
from checkweigher_dsp.denoising.load_rise import load_response
from checkweigher_dsp.denoising.window_batch import WindowBatch, denoised_pass

RATE, BLOCK, COUNT = 960.0, 4, 402  # two samples more than whole blocks
ENTRY = 200 + 1 / 3  # samples
FREQUENCY, DAMPING = 37.0, 0.055
LEVEL, RISE = 0.2, 0.1
UNCERTAINTY = 1.3e-3
LATE = (0.8e-3, -0.5e-3)  # s, by which t1 and t2 are later than the eyes say
AR_TAPS = np.array([1.0, -1.2, 0.5, 0.1, -0.2])


def _response(time, late=(0.0, 0.0)):
    return load_response(time - late[0], RISE + late[1] - late[0], FREQUENCY, DAMPING)


def _time():
    return (np.arange(COUNT) - ENTRY) / RATE


def _noise(seed):
    """Return a disturbance of 1 g: noise through a resonance."""
    noise = lfilter([1.0], [1.0, -1.9, 0.97], np.random.default_rng(seed).normal(size=900))[-COUNT:]
    return 1e-3 * noise / np.std(noise)


def _batch(*forces):
    count = len(forces)
    return WindowBatch(
        tuple(range(count)), np.array(forces), np.tile(_time(), (count, 1)),
        np.full((count, 1), RISE), np.ones((count, 1)), math.ceil(ENTRY),
        math.ceil(ENTRY + RISE * RATE), BLOCK,
    )  # fmt: skip


def _shift(batch, taps=None, level=LEVEL, uncertainty=UNCERTAINTY):
    column = np.ones((len(batch.force), 1))
    fit = EntryFit(batch, uncertainty, level * column, FREQUENCY * column, DAMPING * column)
    return fit.shift(None if taps is None else np.tile(taps, (len(column), 1)))


def _block_means_of_response(late=(0.0, 0.0)):
    """Return the means of the continuous response, from many points in each block."""
    points = 200
    first = COUNT % BLOCK - ENTRY - 0.5
    time = (first + BLOCK * (np.arange(COUNT // BLOCK * points) + 0.5) / points) / RATE
    return _response(time, late).reshape(-1, points).mean(axis=1)


def _independent(force, taps):
    """Return the shift by numpy's least squares, on differences and a filter of scipy."""
    step = 1e-5
    response = _block_means_of_response()
    slopes = [
        LEVEL * (_block_means_of_response(late) - _block_means_of_response(early)) / (2 * step)
        for late, early in (((step, 0), (-step, 0)), ((0, step), (0, -step)))
    ]
    rows = np.array([response, *slopes, block_means(force, BLOCK) - LEVEL * response])
    *unknown, signal = lfilter(taps, [1.0], rows)[:, len(taps) - 1 :]
    unknown = np.stack(unknown, axis=-1)
    found = np.array([unknown[:, 0] @ signal / (unknown[:, 0] @ unknown[:, 0]), 0.0, 0.0])
    for _ in range(2):
        # What is left is noise; the eyes are two more observations, with a noise of their own.
        noise = math.sqrt(np.mean((signal - unknown @ found) ** 2))
        weight = noise / (UNCERTAINTY / math.sqrt(3))
        rows = np.vstack([unknown, [[0, weight, 0], [0, 0, weight]]])
        found, *_ = np.linalg.lstsq(rows, np.r_[signal, 0.0, 0.0], rcond=None)
    return found[1:]


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('known', [True, False])
def test_the_shift_is_the_solution_of_regularised_least_squares(seed, known):
    # 1 % off, as the level of a window is at first.
    force = 1.01 * LEVEL * _response(_time(), LATE) + _noise(seed)
    angle = 2 * math.pi * FREQUENCY * BLOCK / RATE
    pole = np.exp(angle * complex(-DAMPING, math.sqrt(1 - DAMPING**2)))
    of_platform = np.poly([pole, pole.conjugate()]).real

    (shift,) = _shift(_batch(force), AR_TAPS if known else None)

    expected = _independent(force, AR_TAPS if known else of_platform)
    assert 1e-4 < np.abs(expected).max() < 2 * UNCERTAINTY
    np.testing.assert_allclose(shift, expected, atol=1e-4 * UNCERTAINTY)


def test_a_model_of_order_0_is_none():
    batch = _batch(LEVEL * _response(_time(), LATE) + _noise(3))
    np.testing.assert_array_equal(_shift(batch, np.ones(1)), _shift(batch))


def test_a_disturbance_that_hides_the_hump_leaves_the_times_of_the_eyes():
    force = LEVEL * _response(_time(), LATE) + 1e4 * _noise(1)
    np.testing.assert_allclose(_shift(_batch(force)), 0.0, atol=0.01 * UNCERTAINTY)


def test_no_time_is_shifted_by_more_than_twice_the_uncertainty():
    # A hump as of 6 ms, and in opposite directions.
    step = 1e-5
    hump = (_response(_time(), (step, -step)) - _response(_time(), (-step, step))) / (2 * step)
    (shift,) = _shift(_batch(LEVEL * (_response(_time()) + 6e-3 * hump)))
    np.testing.assert_array_equal(shift, [2 * UNCERTAINTY, -2 * UNCERTAINTY])


@pytest.mark.parametrize('gain', [-3.0, 1e-3, 1e6])
def test_the_unit_of_the_signal_does_not_matter(gain):
    force = LEVEL * _response(_time(), LATE) + _noise(2)
    np.testing.assert_allclose(
        _shift(_batch(gain * force), level=gain * LEVEL), _shift(_batch(force)), rtol=1e-9
    )


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@pytest.mark.parametrize(
    ('force', 'level'),
    [
        (np.zeros(COUNT), 0.0),
        (_noise(1), 0.0),
        (np.full(COUNT, math.nan), LEVEL),
        (np.full(COUNT, math.inf), math.inf),
        (_noise(1), math.nan),
    ],
)
def test_where_nothing_can_be_said_the_times_stay(force, level):
    np.testing.assert_array_equal(_shift(_batch(force), level=level), 0.0)


@pytest.mark.parametrize('count', [1, 2, 30])
def test_too_few_samples_leave_the_times(count):
    batch = _batch(LEVEL * _response(_time(), LATE))
    short = replace(
        batch, force=batch.force[:, -count:], time=batch.time[:, -count:], entry=0, begin=0
    )
    np.testing.assert_array_equal(_shift(short), 0.0)


@pytest.mark.parametrize('late', [LATE, (1e-3, 1e-3), (-1.2e-3, 0.0)])
def test_a_pass_whose_edges_are_off_weighs_what_it_does(late):
    # The eyes say 0.3004 s and 0.1 s after that; the product enters when it does.
    t1, noise = 0.3004, 5e-5
    time = np.arange(480) / RATE
    ease = math.sqrt(2.5 / (2.5 + LEVEL))
    force = noise * np.random.default_rng(1).standard_normal(480) + LEVEL * load_response(
        time - t1 - late[0], RISE + late[1] - late[0], 38.0 * ease, 0.06 * ease
    )
    window = make_window(
        force, counts_per_kg=1e9, zero=0.0, stamp=0, window_begin=math.ceil((t1 + RISE) * RATE),
        t1=round(t1 * NANOSECONDS), t2=round((t1 + RISE) * NANOSECONDS),
        t3=round(0.5 * NANOSECONDS),
    )  # fmt: skip

    def error(**values):
        denoised, share = denoised_pass(Denoiser(DenoiseParameters(**values)).denoise(window))
        return abs(np.mean((denoised - LEVEL * share)[share == 1]))

    # What the noise alone may do to the mean of the window.
    limit = 3 * noise / math.sqrt(480 - (t1 + RISE) * RATE)
    assert error(edge_uncertainty=UNCERTAINTY) < limit < error()
