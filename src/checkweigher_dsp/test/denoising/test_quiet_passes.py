# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What each estimator makes of a pass that nothing but its own entry disturbs."""

import numpy as np
import pytest
from synthetic_line import make_pass

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters

MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)
EXACT = 1e-6  # relative
# The platform of the passes, as gauss_markov and denoise would have learned it. The less noise is
# reckoned with, the less the priors pull.
LEARNED = {
    'gauss_markov.sample_rate': 960.0, 'gauss_markov.natural_frequency': 38.0,
    'gauss_markov.damping_ratio': 0.06, 'gauss_markov.moving_mass': 2.5,
    'gauss_markov.noise': [1e-7], 'iswd_eksi.doubt': False,
}  # fmt: skip
# Share of the ring-down in the window, 6 % of the mass at t2, that is taken for mass: before
# training, and what a gain and an offset for all masses leave, as the platform slows with the mass.
BIAS = {
    'mean': (3e-3, 3e-4), 'hann': (3e-4, 3e-5), 'tvlpf': (1e-3, 5e-5), 'iswd_eksi': (5e-6, 2e-6),
    'fir_model': (1e-4, 2e-5), 'learned': (3e-4, 3e-5), 'iswd_eksi_paper': (3e-3, 3e-4),
}  # fmt: skip


@pytest.fixture(scope='module')
def windows():
    denoiser = Denoiser(DenoiseParameters(natural_frequency=(38.0,), damping_ratio=(0.06,)))
    return [denoiser.denoise(make_pass(mass)) for mass in MASSES]


def _weigh(windows, estimator, **training):
    own = {f'{estimator}.{name}': value for name, value in training.items()}
    identifier = Identifier(
        IdentifierParameters.from_mapping({'estimator': estimator, **LEARNED, **own})
    )
    return np.array([identifier.estimate(window).mass for window in windows])


@pytest.mark.parametrize('estimator', [name for name in ESTIMATORS if name not in BIAS])
def test_what_identifies_or_knows_the_platform_is_exact_without_training(windows, estimator):
    assert _weigh(windows, estimator) == pytest.approx(MASSES, rel=EXACT), 'state it in BIAS'


@pytest.mark.parametrize('estimator', BIAS)
def test_what_averages_takes_some_of_the_ring_down_for_mass(windows, estimator):
    errors = np.abs(_weigh(windows, estimator) / MASSES - 1)
    bias, _ = BIAS[estimator]
    assert errors.max() < bias
    # The stated bias is no more than tells the estimators apart.
    assert errors.max() > bias / 5


@pytest.mark.parametrize('estimator', ESTIMATORS)
def test_gain_and_offset_for_all_masses_leave_no_more_than_stated(windows, estimator):
    gain, offset = np.polyfit(_weigh(windows, estimator), MASSES, 1)
    trained = _weigh(windows, estimator, calibrated=True, gain=[gain], offset=[offset])
    _, left = BIAS.get(estimator, (EXACT, EXACT))
    assert trained == pytest.approx(MASSES, rel=left)


@pytest.mark.parametrize('estimator', ESTIMATORS)
def test_samples_after_t3_change_no_mass_that_is_not_exact_anyway(estimator):
    denoiser = Denoiser(DenoiseParameters())
    windows = [denoiser.denoise(make_pass(0.2, trail=trail)) for trail in (0.0, 0.05)]

    plain, trailing = _weigh(windows, estimator)

    if estimator == 'gauss_markov':
        assert trailing == pytest.approx(0.2, rel=EXACT)
    else:
        assert trailing == plain
