# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ISWD-EKSI as plainly as it can be written: PyWavelets, filterpy, one sample after the other.

The reference that the tests hold the kernels to and that `make bench` measures them against. It
shares no arithmetic with them: only the parameters and the records.
"""

from collections.abc import Sequence
import math

from filterpy.kalman import ExtendedKalmanFilter
import numpy as np
import pywt

from checkweigher_core.records import NANOSECONDS, WeighWindow
from checkweigher_dsp.denoising.denoiser import DenoiseParameters
from checkweigher_dsp.denoising.wavelet_shrinkage import Shrinkage
from checkweigher_dsp.estimation.estimators.iswd_eksi import IswdEksiParameters
from checkweigher_dsp.signal.extended_kalman import Noise

_PREDICTION_RATE = 240.0  # Hz


def denoise_periodic(
    stretch: np.ndarray, details: Sequence[Shrinkage | None], wavelet: str = 'db16'
) -> np.ndarray:
    """Shrink the stationary wavelet transform of a periodic stretch (n,) float64."""
    approximation, *bands = pywt.swt(
        stretch, wavelet, level=len(details), trim_approx=True, norm=False
    )
    shrunk = []
    for band, shrinkage in zip(bands, reversed(details), strict=True):
        if shrinkage is None:
            shrunk.append(np.zeros_like(band))
            continue
        size = np.abs(band)
        soft = np.sign(band) * shrinkage.gain * (size - shrinkage.threshold)
        shrunk.append(np.where(size >= shrinkage.threshold, soft, 0.0))
    return pywt.iswt([approximation, *shrunk], wavelet, norm=False)


class MatrixFilter(ExtendedKalmanFilter):
    """The EKF of the method on X = [x(k), x(k-1), a1, a2, b1]."""

    def __init__(self, measurement: float, noise: Noise) -> None:
        super().__init__(dim_x=5, dim_z=1)
        self.P = np.diag([noise.initial] * 2 + [noise.coefficients] * 2 + [noise.initial])
        self.Q = np.diag([noise.process * measurement, 0.0, 0.0, 0.0, 0.0])
        self.R = np.array([[measurement]])
        self.H = np.array([[1.0, 0.0, 0.0, 0.0, 0.0]])
        self.F = np.eye(5)
        self.F[1] = [1.0, 0.0, 0.0, 0.0, 0.0]
        self.load = 1.0

    def predict_x(self, u: float = 0) -> None:
        """Move the state one sample on."""
        x, y, a1, a2, b1 = self.x[:, 0]
        self.x = np.array([[-a1 * x - a2 * y + b1 * self.load], [x], [a1], [a2], [b1]])

    def step(self, sample: float, load: float = 1.0, measurement: float | None = None) -> None:
        """Predict and update with one sample."""
        x, y, a1, a2, _ = self.x[:, 0]
        self.load = load
        self.F[0] = [-a1, -a2, -x, -y, load]
        if measurement is not None:
            self.R = np.array([[measurement]])
        self.predict()
        self.update(np.array([[sample]]), lambda _: self.H, lambda state: self.H @ state)


def identify_window(
    denoised: np.ndarray, removed_variance: float, inputs: np.ndarray, noise: Noise, rise: float
) -> tuple[float, float]:
    """Return steady state and its variance that the filter finds in a window (n,) float64."""
    scale = denoised[inputs >= 1].mean()
    r = max(noise.measurement * removed_variance / scale**2, 1e-14)
    matrix_filter = MatrixFilter(r, noise)
    for sample, load in zip(denoised / scale, inputs, strict=True):
        matrix_filter.step(sample, load, rise * r if load < 1 else r)
    a1, a2, b1 = matrix_filter.x[2:, 0]
    total = 1 + a1 + a2
    slope = np.array([-b1 / total**2, -b1 / total**2, 1 / total])
    return scale * b1 / total, scale**2 * (slope @ matrix_filter.P[2:, 2:] @ slope)


def weigh_window(
    window: WeighWindow, parameters: DenoiseParameters, known: IswdEksiParameters
) -> tuple[float, float]:
    """Return load (kg) and variance (kg^2) of a window, padded by `surround` continuation.

    Parameters
    ----------
    window : WeighWindow
        A whole one.
    parameters : DenoiseParameters
        With one natural frequency and one damping ratio.
    known : IswdEksiParameters
        Variances of the filter, with one `rise_noise`.
    """
    begin, end, rate = window.window_begin, window.window_end, window.sample_rate
    count = end - begin
    length = 128 * math.ceil(max(parameters.stretch, 2 * count) / 128)
    lead = min((length - count) // 2, begin - window.empty_begin) // 16 * 16
    rise = (window.t2 - window.t1) / NANOSECONDS
    begin_time = rise + min(
        max(begin / rate - (window.t2 - window.stamp) / NANOSECONDS, 0), 1 / rate
    )
    time = begin_time + (np.arange(begin - lead, end) - begin) / rate
    force = (window.counts[begin - lead : end] - window.zero) / window.counts_per_kg
    share = np.clip(time / rise, 0, 1)
    block = max(1, round(rate / _PREDICTION_RATE))
    before = (length - count) // 2 - lead
    after = length - before - len(force)
    details = parameters.table.at(window.belt_speed, parameters.threshold_unit)
    level = force[lead:].mean()
    for _ in range(parameters.iterations + 1):
        ease = math.sqrt(parameters.moving_mass / (parameters.moving_mass + max(level, 0)))
        response = load_response(
            time, rise, parameters.natural_frequency[0] * ease, parameters.damping_ratio[0] * ease
        )
        disturbance = force - level * response
        clean_stretch = denoise_periodic(
            level
            + np.concatenate(
                [
                    _continue(disturbance[::-1], disturbance, before, parameters, block)[::-1],
                    disturbance,
                    _continue(disturbance, disturbance, after, parameters, block),
                ]
            ),
            details,
        )
        used = level
        clean = clean_stretch[before : before + len(force)]
        level = clean[lead:].mean()
    denoised = clean - used * (1 - share)
    entry = int(np.sum(time < 0))
    inputs = share[entry:]
    inputs[lead - entry :] = 1.0
    removed = np.var(force[lead:] - denoised[lead:])
    return identify_window(denoised[entry:], removed, inputs, known.noise, known.rise_noise[0])


def load_response(time: np.ndarray, rise: float, frequency: float, damping: float) -> np.ndarray:
    """Return what a platform at rest reads of a load that rises from 0 to 1 over `rise`."""
    omega = 2 * math.pi * frequency
    damped = omega * math.sqrt(1 - damping**2)
    lag = 2 * damping / omega

    def climb(since: np.ndarray) -> np.ndarray:
        since = np.maximum(since, 0)
        swing = lag * np.cos(damped * since) + (2 * damping**2 - 1) / damped * np.sin(
            damped * since
        )
        return since - lag + np.exp(-damping * omega * since) * swing

    return (climb(time) - climb(time - rise)) / rise


def _continue(
    signal: np.ndarray,
    fitted: np.ndarray,
    count: int,
    parameters: DenoiseParameters,
    block: int,
) -> np.ndarray:
    """Return the samples after a signal, by the model of what it is `fitted` to."""
    means = _block_means(signal, block)
    taps = burg(_block_means(fitted, block), min(parameters.prediction_order, len(means) // 3))
    predicted = [*means]
    for _ in range(count // block + 2):
        predicted.append(-sum(c * x for c, x in zip(taps[1:], predicted[::-1], strict=False)))
    centres = (np.arange(len(predicted) - len(means) + 1) - 0.5) * block + 0.5
    return np.interp(np.arange(1, count + 1), centres, predicted[len(means) - 1 :])


def _block_means(signal: np.ndarray, block: int) -> np.ndarray:
    count = len(signal) // block
    return signal[len(signal) - count * block :].reshape(count, block).mean(axis=1)


def burg(signal: np.ndarray, order: int) -> np.ndarray:
    """Return the prediction-error filter (order + 1,) of a signal by Burg's method."""
    taps = np.ones(1)
    forward, backward = signal[1:], signal[:-1]
    for _ in range(order):
        reflection = -2 * np.sum(forward * backward) / np.sum(forward**2 + backward**2)
        forward, backward = (
            (forward + reflection * backward)[1:],
            (backward + reflection * forward)[:-1],
        )
        taps = np.append(taps, 0) + reflection * np.append(taps, 0)[::-1]
    return taps
