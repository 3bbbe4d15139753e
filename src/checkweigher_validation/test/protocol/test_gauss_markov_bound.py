# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gauss-Markov bound, compared with cases worked by hand and with simulated passes."""

from dataclasses import replace
from itertools import pairwise
import math

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import butter, lfilter, sosfilt

from checkweigher_core.records import NANOSECONDS
from checkweigher_recording.simulation.noise import FLOOR_BAND
from checkweigher_recording.simulation.simulator import (
    DAMPING_RATIO,
    OVERSAMPLING,
    PROFILES,
    Profile,
    SimulationParameters,
    simulate,
)
from checkweigher_validation.protocol.gauss_markov_bound import (
    PassModel,
    bound,
    bound_of,
    pass_model,
)

BEFORE = 0.05  # s; short, so that the covariance is small
SILENT = PROFILES['quiet']


@pytest.fixture
def machine(monkeypatch):
    """Return a function that replaces the machine of the profile 'quiet'."""

    def become(profile: Profile, **parameters) -> SimulationParameters:
        monkeypatch.setitem(PROFILES, 'quiet', profile)
        return SimulationParameters(profile='quiet', **parameters)

    return become


def passes_of(parameters, mass, before, count=150):
    """Simulate passes far apart, and return their samples from `before` s before t1 to t3."""
    # Entries on whole seconds, and so on samples; 2 m apart, when nothing rings any more.
    spaced = replace(
        parameters, masses=(mass,), count=count, spacing=2.0 * parameters.speed, lead_in=2.0
    )
    recording = simulate(spaced)
    counts = np.concatenate([block.counts for block in recording.blocks])
    reading = (counts - spaced.zero_counts) / spaced.counts_per_kg
    start = spaced.start_time * NANOSECONDS
    rate = spaced.sample_rate
    begins = [
        round((reference.stamp - start) * rate / NANOSECONDS) - round(before * rate)
        for reference in recording.references
    ]
    duration = before + spaced.weigh_length / spaced.speed
    size = math.ceil(round(duration * rate, 6))
    return np.stack([reading[begin : begin + size] for begin in begins])


def test_with_white_noise_alone_the_bound_is_its_deviation_over_the_norm_of_the_response():
    response = np.array((0.0, 0.5, 1.0, 1.0))
    model = PassModel(np.arange(4.0), response, 0.04 * np.eye(4))

    # 0.2 / sqrt(0.25 + 1 + 1).
    assert bound_of(model) == pytest.approx(0.2 / 1.5, rel=1e-12)


def test_the_bound_of_a_constant_in_autoregressive_noise_is_that_of_theory():
    # Noise r(k) = p r(k-1) + e, mean of n samples: the information on a constant is
    # (1 - p) ((n - 2) (1 - p) + 2) / s^2, with s the deviation of e (Box, Jenkins).
    p, n = 0.8, 50
    covariance = toeplitz(p ** np.arange(n)) / (1 - p**2)
    model = PassModel(np.arange(n), np.arange(n) * 0 + 1.0 + 1e-9 * np.arange(n), covariance)

    information = (1 - p) * ((n - 2) * (1 - p) + 2)
    assert bound_of(model) == pytest.approx(1 / math.sqrt(information), rel=1e-6)


def test_a_quiet_machine_is_bounded_by_its_electronic_noise():
    # Nearly the bound of white noise for the load as it rides on, 0.1 s, and rests, 0.1 s:
    # s^2 sums to 96 / 3 + 96 = 128 samples. The ringing of the platform adds little to that.
    its = bound(SimulationParameters(profile='quiet'), 0.1645)

    assert its == pytest.approx(0.05e-3 / math.sqrt(128), rel=0.02)


def test_the_bounds_of_profile_paper_are_those_of_a_sum_of_sines():
    # Independent computation: broadband noise and floor as sines of all frequencies in steps of
    # 0.5 Hz, each through the platform, in g at 30 .. 90 m/min.
    expected = (0.0235, 0.0428, 0.0659, 0.0918, 0.1210)

    its = [bound(SimulationParameters(speed=speed / 60), 0.0745) for speed in range(30, 91, 15)]

    assert [1e3 * one for one in its] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize('profile', PROFILES)
def test_more_signal_never_makes_the_bound_larger(profile):
    parameters = SimulationParameters(profile=profile)
    its = [bound(parameters, 0.1645, before) for before in (0.0, 0.02, 0.05, 0.1, 0.3)]

    for less, more in pairwise(its):
        assert more <= less * (1 + 1e-9)


def test_more_noise_of_any_kind_makes_the_bound_larger(machine):
    base = replace(PROFILES['paper'], roller=(0.4e-3,))
    reference = bound(machine(base), 0.1645)

    changes = {'impact': 0.06, 'roller': (0.8e-3,), 'motor': 1e-3, 'broadband': 0.066e-3}
    for name, value in {**changes, 'floor': 0.1e-3, 'electronic': 0.1e-3}.items():
        assert bound(machine(replace(base, **{name: value})), 0.1645) > reference, name


def test_the_response_is_what_the_noise_free_simulator_reads(machine):
    parameters = machine(replace(SILENT, electronic=0.0), counts_per_kg=1e6, speed=1.0)
    (reading,) = passes_of(parameters, 0.2, BEFORE, count=1)
    model = pass_model(parameters, 0.2, BEFORE)

    # Steps of the converter are 1e-6 kg, and the product may seem to get on one step of the
    # integration, 0.13 ms of 100 ms, earlier where the two round differently.
    np.testing.assert_allclose(0.2 * model.response, reading, atol=2e-6)
    assert model.time[0] == pytest.approx(-BEFORE)
    assert model.time[-1] == pytest.approx(0.2 - 1 / 960)


def test_broadband_noise_has_the_covariance_of_the_platform_at_rest(machine):
    # Before the product enters the platform is time-invariant: its impulse response, averaged over
    # a sample, correlated with itself.
    parameters = machine(replace(SILENT, broadband=1e-3, electronic=0.0))
    model = pass_model(parameters, 0.1, BEFORE)
    rate = 960 * OVERSAMPLING
    omega = 2 * math.pi * SILENT.natural_frequency
    damped = omega * math.sqrt(1 - DAMPING_RATIO**2)
    time = np.arange(1, rate + 1) / rate
    # Response to a force that is 1 for one step: the difference of two step responses.
    settled = np.exp(-DAMPING_RATIO * omega * time) * (
        np.cos(damped * time) + DAMPING_RATIO * omega / damped * np.sin(damped * time)
    )
    pulse = np.diff(np.concatenate(([0.0], 1 - settled)))
    averaged = np.convolve(pulse, np.full(OVERSAMPLING, 1 / OVERSAMPLING))
    variance = (1e-3) ** 2 * rate / 2
    expected = [
        variance * averaged[lag:] @ averaged[: len(averaged) - lag]
        for lag in OVERSAMPLING * np.arange(20)
    ]

    # The converter's steps add 3e-13 to the diagonal.
    np.testing.assert_allclose(model.covariance[0, :20], expected, rtol=1e-6)


def test_the_floor_has_the_power_of_its_filter_behind_the_platform(machine):
    parameters = machine(replace(SILENT, floor=1e-3, electronic=0.0))
    variance = pass_model(parameters, 0.1, BEFORE).covariance[0, 0]
    rate = 960 * OVERSAMPLING
    sections = butter(2, FLOOR_BAND, 'bandpass', fs=rate, output='sos')
    impulse = sosfilt(sections, np.eye(1, 4 * rate)[0])
    size = 1e-3**2 * (rate / 2) / (math.pi / 4 / math.sin(math.pi / 4) * 8)
    omega = 2 * math.pi * SILENT.natural_frequency / rate
    # The platform by its difference equation as in the driver's own notes, gain 1.
    poles = np.exp(-DAMPING_RATIO * omega) * np.exp(1j * omega * math.sqrt(1 - DAMPING_RATIO**2))
    denominator = np.array((1.0, -2 * poles.real, abs(poles) ** 2))
    numerator = (0.0, denominator.sum() / 2, denominator.sum() / 2)
    shaken = lfilter(numerator, denominator, impulse)
    reading = lfilter(np.ones(OVERSAMPLING) / OVERSAMPLING, 1.0, shaken)

    assert variance == pytest.approx(size * reading @ reading, rel=1e-3)


@pytest.mark.parametrize('profile', ['paper', 'roller', 'soft', 'floor'])
def test_passes_of_the_simulator_scatter_as_the_bound_says(machine, profile):
    # Without jitter of the speed every pass has the same response.
    parameters = machine(replace(PROFILES[profile], speed_jitter=0.0), seed=3)
    mass, count = 0.1645, 150
    model = pass_model(parameters, mass, BEFORE)
    weights = np.linalg.solve(model.covariance, model.response)
    weights /= weights @ model.response
    passes = passes_of(parameters, mass, BEFORE, count)
    errors = passes @ weights - mass

    std_dev = bound_of(model)
    # Four standard deviations of a mean and of a standard deviation of normal numbers.
    assert abs(errors.mean()) < 4 * std_dev / math.sqrt(count)
    assert errors.std(ddof=1) == pytest.approx(std_dev, rel=4 / math.sqrt(2 * count))
    # The noise as a whole: its whitened squares sum to the number of samples. The lines have
    # fewer directions than passes and no normal distribution, which takes hardly anything away.
    noise = passes - mass * model.response
    squares = np.einsum('ij,ij->i', noise, np.linalg.solve(model.covariance, noise.T).T)
    size = len(model.response)
    assert squares.mean() == pytest.approx(size, rel=4 * math.sqrt(2 / (size * count)))
