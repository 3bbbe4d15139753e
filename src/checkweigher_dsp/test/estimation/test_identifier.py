# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""From a denoised window to a mass, or to the reason why there is none."""

from dataclasses import replace
import math

from known_models import coefficients
import numpy as np
import pytest
from synthetic_line import make_pass, make_window

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.denoiser import PADDINGS, DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.estimators import METHODS, REFERENCES
from checkweigher_dsp.estimation.estimators.averages import MeanParameters
from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksiParameters
from checkweigher_dsp.estimation.identifier import (
    ESTIMATORS,
    ComparedParameters,
    Identifier,
    IdentifierParameters,
)

# R / P0 of a noise-free window is 1e-12: so much the prior may pull, with room for rounding.
PRIOR = 1e-10
GAIN = 1e-9


def _denoised(window, **parameters):
    """Denoise; on a bare window there is nothing to continue, so it stands on its level."""
    return Denoiser(DenoiseParameters(**{'surround': 'level', **parameters})).denoise(window)


def _identifier(estimator, **values):
    """Return an identifier whose estimator has some values of its own."""
    own = {f'{estimator}.{name}': value for name, value in values.items()}
    return Identifier(ComparedParameters.from_mapping({'estimator': estimator, **own}))


def _oscillation(mass=0.2, count=96, seed=2):
    k = np.arange(count)
    ringing = 0.02 * np.exp(-0.015 * k) * np.cos(0.25 * k)
    return mass + ringing + 1e-4 * np.random.default_rng(seed).standard_normal(count)


def test_the_mass_is_the_load_above_the_zero_and_not_above_the_calibration():
    window = _denoised(make_window([0.2] * 64, zero_counts=4000.0))
    estimate = Identifier(IdentifierParameters()).estimate(window)
    assert estimate.mass == pytest.approx(0.2, rel=PRIOR)
    # The belt reads 1000 counts of 1e6 a kg more than at calibration.
    assert estimate.zero == pytest.approx(0.001, rel=PRIOR)


def test_a_platform_is_identified_where_nothing_is_denoised_away():
    # Step response from rest of 38 Hz, damping 0.06, at 960 Hz, by the closed forms; what was
    # removed is next to nothing, so the filter follows the samples.
    a1, a2 = coefficients(38.0, 0.06)
    x = [0.0, 0.0]
    for _ in range(96):
        x.append(-a1 * x[-1] - a2 * x[-2] + 0.2 * (1 + a1 + a2))
    window = make_window(x[2:], counts_per_kg=1e9)

    # P0 = I: by default the platform is held to be as stiff as denoising makes it look.
    known = IswdEksiParameters(coefficient_variance=1.0)
    estimate = Identifier(IdentifierParameters(iswd_eksi=known)).estimate(
        replace(window, denoised=np.array(x[2:]))
    )

    # Within the rounding to counts of 1e-9 kg.
    assert estimate.mass == pytest.approx(0.2, rel=1e-6)
    assert estimate.natural_frequency == pytest.approx(38.0, rel=1e-4)
    assert estimate.damping_ratio == pytest.approx(0.06, rel=1e-4)


@pytest.mark.parametrize('estimator', sorted(METHODS))
@pytest.mark.parametrize('surround', PADDINGS)
@pytest.mark.parametrize('gain', [-1, 3, 128])
def test_the_gain_of_the_load_cell_does_not_matter(estimator, surround, gain):
    random = np.random.default_rng(2)
    window = make_pass(disturbance=lambda time: 1e-3 * random.standard_normal(len(time)))
    # Readings of 1e-6 kg leave room for a gain.
    window = replace(
        window, counts=window.counts // 1000, counts_per_kg=1e6, zero=7.0, zero_std_dev=12.0
    )
    scaled = replace(
        window,
        counts=gain * window.counts,
        counts_per_kg=gain * window.counts_per_kg,
        zero_counts=gain * window.zero_counts,
        zero=gain * window.zero,
        zero_std_dev=abs(gain) * window.zero_std_dev,
    )
    identifier = _identifier(estimator)

    plain, other = (identifier.estimate(_denoised(w, surround=surround)) for w in (window, scaled))

    assert plain.weighed
    assert (other.mass, other.std_dev) == pytest.approx((plain.mass, plain.std_dev), rel=GAIN)


def test_the_variance_of_the_zero_is_added():
    identifier = Identifier(IdentifierParameters())
    window = _denoised(make_window(_oscillation()))

    without, within = (
        identifier.estimate(replace(window, zero_std_dev=std_dev)) for std_dev in (0.0, 300.0)
    )

    # 300 counts of 1e6 a kg.
    assert within.std_dev**2 - without.std_dev**2 == pytest.approx(0.0003**2, rel=1e-6)
    assert within.mass == without.mass


def test_the_window_of_a_fault_becomes_an_estimate_with_its_reasons():
    fault = WeighWindow(7, 1, None, 3, 1.5, line_speed=1.5, reasons=('MissingEdge', 'BeltSpeed'))

    estimate = Identifier(IdentifierParameters()).estimate(fault)

    assert not estimate.weighed
    assert (estimate.item_id, estimate.t1, estimate.t2, estimate.t3) == (7, 1, None, 3)
    assert estimate.reasons == ('MissingEdge', 'BeltSpeed')
    assert (estimate.belt_speed, estimate.estimator) == (1.5, 'iswd_eksi')
    assert math.isnan(estimate.mass)
    assert math.isnan(estimate.std_dev)


@pytest.mark.parametrize(
    'denoised',
    [
        np.full(64, math.nan),
        np.full(64, math.inf),
        np.zeros(64),
        np.tile([1.0, -1.0], 32),  # mean 0
        1.05 ** np.arange(64.0),  # pole outside the unit circle
    ],
    ids=['nan', 'inf', 'empty', 'alternating', 'growing'],
)
@pytest.mark.filterwarnings('ignore::RuntimeWarning')
def test_what_identifies_no_stable_platform_is_no_convergence(denoised):
    window = make_window(np.nan_to_num(denoised, posinf=0.0), counts_per_kg=1e6)
    estimate = Identifier(IdentifierParameters()).estimate(replace(window, denoised=denoised))
    assert estimate.reasons == ('NoConvergence',)
    assert math.isnan(estimate.mass)


@pytest.mark.parametrize(('off', 'reasons'), [(0.015, ()), (-0.025, ('NoConvergence',))])
def test_a_mass_that_the_samples_do_not_go_around_is_no_convergence(off, reasons):
    window = _denoised(make_window([0.2] * 64))
    begin, end = window.window_begin, window.window_end
    quiet = replace(window, denoised=(1 + off) * window.denoised)
    shaken = replace(quiet, counts=quiet.counts.copy())
    shaken.counts[begin:end] += np.tile([1, -1], 32).astype(np.int32) * round(0.004 * 1e6)

    # 4 g of 200 g is a standard deviation of 2 %, of which two may be added to the 2 %.
    assert Identifier(IdentifierParameters()).estimate(quiet).reasons == reasons
    assert Identifier(IdentifierParameters()).estimate(shaken).reasons == ()


def test_a_mass_that_is_too_uncertain_is_no_convergence():
    # Standard deviation of the zero: 30 g of 200 g is more than a tenth and less than a fifth.
    window = _denoised(make_window([0.2] * 64, zero_std_dev=30_000.0))

    strict, mild = (
        Identifier(IdentifierParameters(max_relative_std_dev=limit)).estimate(window)
        for limit in (0.1, 0.2)
    )

    assert strict.reasons == ('NoConvergence',)
    assert mild.reasons == ()


@pytest.mark.parametrize(
    'fields',
    [{'denoised': np.zeros(0)}, {'denoised': np.ones(63)}, {'counts_per_kg': 0.0},
     {'window_end': 65}],
    ids=str,
)  # fmt: skip
def test_a_window_that_contradicts_itself_is_a_bad_window(fields):
    window = replace(_denoised(make_window([0.2] * 64)), **fields)
    assert Identifier(IdentifierParameters()).estimate(window).reasons == ('BadWindow',)


@pytest.mark.parametrize('mass', [-0.1, -1e-6])
def test_a_product_that_weighs_less_than_nothing_is_no_mass(mass):
    estimate = Identifier(IdentifierParameters()).estimate(_denoised(make_window([mass] * 64)))
    assert estimate.reasons == ('NoLoad',)
    assert math.isnan(estimate.mass)


# Trained at 0.5 and 1.5 m/s.
TRAINED = {
    'calibrated': True, 'speeds': (0.5, 1.5), 'gain': (1.0, 1.02), 'offset': (0.0, -0.002),
    'std_dev': (2e-4, 4e-4), 'relative_std_dev': (0.001, 0.002), 'zero_std_dev': (1e-4, 3e-4),
}  # fmt: skip


def _constant(speed, zero_std_dev=0.0):
    """Return a window of constant 0.2 kg; the zero in kg."""
    return _denoised(make_window([0.2] * 64, belt_speed=speed, zero_std_dev=1e6 * zero_std_dev))


# gain * 0.2 + offset, and std_dev^2 + (relative_std_dev * mass)^2, by hand.
@pytest.mark.parametrize(
    ('speed', 'mass', 'variance'),
    [
        (0.5, 0.2, 2e-4**2 + 0.0002**2),
        (0.49, 0.2, 2e-4**2 + 0.0002**2),  # within the tolerance: as at the slowest speed
        (1.0, 0.201, 3e-4**2 + 0.0003015**2),
        (1.25, 0.2015, 3.5e-4**2 + 0.000352625**2),
        (1.5, 0.202, 4e-4**2 + 0.000404**2),
    ],
)
@pytest.mark.parametrize('estimator', ESTIMATORS)
def test_what_training_taught_is_interpolated_and_applied(estimator, speed, mass, variance):
    estimate = _identifier(estimator, **_trained(estimator)).estimate(_constant(speed))

    assert estimate.reasons == ()
    assert estimate.mass == pytest.approx(mass, rel=PRIOR)
    assert estimate.std_dev == pytest.approx(math.sqrt(variance), rel=1e-9)


def _trained(estimator):
    """TRAINED with the lists that the estimator has of its own, doubled for the two speeds."""
    own = getattr(IdentifierParameters(), estimator).as_mapping()
    lists = {name: value * 2 for name, value in own.items() if isinstance(value, tuple)}
    return {**lists, **TRAINED}


@pytest.mark.parametrize(
    ('zero_std_dev', 'excess'),
    # At 1 m/s the zero of the training passes was good for 2e-4 kg.
    [(0.0, 0.0), (1e-4, 0.0), (2e-4, 0.0), (3e-4, 5e-8), (1e-3, 96e-8)],
)
@pytest.mark.parametrize('estimator', ESTIMATORS)
def test_only_what_the_zero_is_worse_than_in_training_is_added(estimator, zero_std_dev, excess):
    estimate = _identifier(estimator, **_trained(estimator)).estimate(_constant(1.0, zero_std_dev))

    variance = 3e-4**2 + 0.0003015**2 + excess
    assert estimate.std_dev == pytest.approx(math.sqrt(variance), rel=1e-9)


def _stated(load, **values):
    """Return the standard deviation of a constant load in kg at 1 m/s, after training."""
    known = MeanParameters(**{**TRAINED, **values})
    window = _denoised(make_window([load] * 64, belt_speed=1.0))
    return Identifier(IdentifierParameters(estimator='mean', mean=known)).estimate(window).std_dev


# At 1 m/s, the trained masses are 0.15 to 0.25 kg.
TRAINED_MASSES = {'lightest_mass': (0.1, 0.2), 'heaviest_mass': (0.2, 0.3)}


@pytest.mark.parametrize('load', [0.151, 0.2, 0.247])
def test_within_the_trained_masses_a_file_without_them_states_the_same_to_the_bit(load):
    assert _stated(load, **TRAINED_MASSES) == _stated(load)


# With mass = 1.01 * load - 0.001, by hand: 18 times mass times distance at 0.25 kg, where the file
# states hypot(0.0003, 0.0015 * 0.25) kg, and 0.7 times the relative distance at 0.15 kg.
@pytest.mark.parametrize(
    ('load', 'growth', 'nearest'),
    [(0.4, 18 * 0.403 * 0.153, 0.25), (0.1, 0.7 * 0.05 / 0.15, 0.15)],
)
def test_beyond_the_trained_masses_the_stated_deviation_grows(load, growth, nearest):
    beyond = growth * math.hypot(3e-4, 0.0015 * nearest)
    expected = math.hypot(_stated(load), beyond)
    assert _stated(load, **TRAINED_MASSES) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('estimator', REFERENCES)
def test_no_line_offers_a_method_that_is_only_compared(estimator):
    with pytest.raises(ParameterError, match=f'identifier.estimator: .*{estimator}'):
        IdentifierParameters(estimator=estimator)
    assert not any(name.startswith(f'{estimator}.') for name in IdentifierParameters.entries())


@pytest.mark.parametrize('calibrated', [False, True])
@pytest.mark.parametrize(
    ('speed', 'outside'),
    # 0.5 * 0.9 = 0.45 and 1.5 * 1.1 = 1.65
    [(0.449, True), (0.451, False), (1.0, False), (1.649, False), (1.651, True)],
)
def test_a_speed_beyond_training_is_not_trained_if_there_was_training(calibrated, speed, outside):
    known = MeanParameters(**{**TRAINED, 'calibrated': calibrated})
    identifier = Identifier(IdentifierParameters(estimator='mean', mean=known, speed_tolerance=0.1))

    estimate = identifier.estimate(_constant(speed))

    assert estimate.reasons == (('SpeedNotTrained',) if calibrated and outside else ())


def test_what_another_estimator_was_taught_does_not_matter():
    other = IdentifierParameters(estimator='hann', mean=MeanParameters(**TRAINED))
    assert Identifier(other).estimate(_constant(1.0)).mass == pytest.approx(0.2, rel=PRIOR)


def test_without_training_gain_and_offset_are_applied_and_the_variance_is_its_own():
    window = _denoised(make_window(_oscillation(), zero_std_dev=300.0))
    plain = _identifier('mean').estimate(window)
    taught = _identifier('mean', gain=[2.0], offset=[0.01], std_dev=[0.5]).estimate(window)
    assert taught.mass == pytest.approx(2 * plain.mass + 0.01, rel=GAIN)
    assert taught.std_dev == plain.std_dev
