# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Tuning of the learned estimator, whose weights follow from a covariance C of the signal.

.. math:: C = R'R + a N + \sigma^2 (b I + c E + d K_r + e K_j + f K_b) + n (u u' + v v' + z^2 1 1').

R contains the residuals of the n passes of a speed from their mean curve, and :math:`\sigma^2` is
the mean of the variances of R. The other terms of C dominate if there are few passes. Each of the
coefficients a, b, d, e and f is the number of passes to which its term is equivalent, and c is the
weight of a pass at another speed. N is the covariance of the noise of the empty belt, and the
identity matrix I is the covariance of white noise. E is a sum over the other speeds: R'R at the
same positions on the belt, divided by the mean of the variances of R at that speed. K_r, K_j and
K_b are models of the covariances of three disturbances. K_r describes damped swings that begin
during the entry or at t2. K_j describes jitter of the edges, which moves or stretches the curve.
K_b describes an uneven rise, as a Brownian bridge from t1 to t2. The vector u is the change of the
curve for a heavier product, whose oscillation is slower, and v the change if its load rises later.
The vectors u and v are 0 if the masses differ enough, because R then contains the change of the
curve. z is twice the stated standard deviation of the zero. The error of the zero is nearly equal
in successive passes, and thus not visible in R.

The weights are averaged over a grid and random points of the coefficients. The likelihood of a
point is computed from the held-out errors of the passes: the weights for a pass are learned from
the other passes. A point is weighted by the square root of its likelihood, because few errors
determine the likelihood only roughly, and by the square root of its geometric mean likelihood at
the other speeds. [own derivation]
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import rise_time, transit
from checkweigher_dsp.estimation.estimators.learned import (
    PARTS,
    Layout,
    LearnedParameters,
    pass_features,
    rise_parts,
    seconds_alone,
)
from checkweigher_dsp.estimation.learning.regression import held_out
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.autoregression import pooled_autocovariance
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import are_distinct, calibrate
from checkweigher_validation.tuning.tunables import Tunable

_LONGEST_LEAD = 0.75  # longest used signal before t1, as a multiple of t3 - t1.
# Quantile of the gaps before the products that is used as the gap of the training passes at a
# speed.
_ALONE = 0.02
_LESS = 0.95  # ratio of the gap required in production to that of the training passes
_FEWEST = 3  # smallest number of passes from which weights are learned
_SLOWER = 0.01  # assumed relative difference of the natural frequency between products
_LATER = 0.5  # assumed difference of the time of the rise between products, in features
_ZERO = 2.0  # ratio of z to the standard deviation of the zero that the segmenter states
_LEAST_VARIANCE = 1e-18  # smallest variance in kg^2, to avoid a division by 0.
# Grid of the coefficients a, b and c. The coefficients d, e and f are 0, for machines without
# swings, jitter and uneven rise.
_GRID = tuple(
    product((0.0, 1.0, 10.0, 100.0), (0.01, 0.1, 1.0, 10.0), (0.0, 0.1, 1.0), *[(0.0,)] * 3)
)
# Ranges of the coefficients a to f for the random points, and the number of these points.
_RANGES = ((0.5, 300.0), (1e-3, 10.0), (3e-3, 3.0), (3e-3, 10.0), (3e-3, 10.0), (1e-2, 10.0))
_RANDOM = 64
# Powers of the likelihood at the speed, and of the geometric mean likelihood at the other speeds.
_OWN, _ELSEWHERE = 0.5, 0.5
_SEED = 1
# Damped swings: frequencies in Hz, decay times in s, and beginnings as multiples of t2 - t1.
_SWINGS = np.geomspace(8.0, 60.0, 12)
_DECAYS = np.geomspace(0.012, 0.08, 4)
_BEGINNINGS = (0.3, 0.5, 1.0)


def _points() -> NDArray[np.float64]:
    """Return the points of the coefficients, (points, 6): a grid, and random points in a box."""
    from scipy.stats import qmc  # imported late, because the import is slow

    low, high = np.array(_RANGES).T
    cube = qmc.LatinHypercube(len(_RANGES), rng=np.random.default_rng(_SEED))
    return np.vstack((_GRID, low * (high / low) ** cube.random(_RANDOM)))


@dataclass(frozen=True, slots=True)
class Evidence:
    """Features and true masses of the passes of one speed."""

    features: NDArray[np.float64]  # (n, k), in kg
    masses: NDArray[np.float64]  # (n,), in kg

    def select(self, rows: NDArray[np.bool_]) -> 'Evidence':
        """Return the evidence of the passes for which the mask `rows`, (n,), is True."""
        return Evidence(self.features[rows], self.masses[rows])

    @property
    def curve(self) -> NDArray[np.float64]:
        """Features per kg of load, (k,), fitted to the passes by least squares."""
        return np.asarray(self.masses @ self.features / (self.masses @ self.masses))

    @property
    def residuals(self) -> NDArray[np.float64]:
        """Residuals R, (n, k) in kg: the features minus the product of mass and `curve`."""
        return np.asarray(self.features - np.outer(self.masses, self.curve))

    @property
    def scatter(self) -> NDArray[np.float64]:
        """Product R'R of the residuals, (k, k), in kg^2."""
        residuals = self.residuals
        return np.asarray(residuals.T @ residuals)


_MATRICES = ('noise', 'elsewhere', 'swings', 'rise')  # terms of `Prior` with the shape (k, k)


@dataclass(frozen=True, slots=True)
class Prior:
    """Terms of the covariance that do not depend on the residuals R of the speed."""

    noise: NDArray[np.float64]  # covariance of the noise of the empty belt, (k, k), in kg^2.
    # Sum over the other speeds of R'R divided by the mean of the variances of R, (k, k).
    elsewhere: NDArray[np.float64]
    swings: NDArray[np.float64]  # covariance of damped swings, (k, k), with a mean variance of 1
    rise: NDArray[np.float64]  # covariance of an uneven rise, (k, k), with a mean variance of 1.
    # Time of each feature after t1, (k,), in durations of a feature. It is 0 before t1.
    time: NDArray[np.float64]
    zero: float = 0.0  # variance z^2 of the zero in kg^2

    def last(self, count: int) -> 'Prior':
        """Return the terms of the last `count` features."""
        end = slice(-count, None)
        cut = {name: getattr(self, name)[end, end] for name in _MATRICES}
        return replace(self, **cut, time=self.time[end])


def covariances(known: Evidence, prior: Prior) -> NDArray[np.float64]:
    """Return the covariance C for each point of the coefficients, (points, k, k), in kg^2."""
    count, curve, scatter = len(known.masses), known.curve, known.scatter
    parts = len(curve)
    variance = max(float(np.trace(scatter)) / parts / count, _LEAST_VARIANCE)
    slope = np.gradient(curve)
    if not are_distinct(known.masses):
        for change in (_SLOWER * prior.time * slope, _LATER * slope):
            change = float(known.masses.mean()) * change
            scatter = scatter + count * np.outer(change, change)
    jitter = (_scaled(np.outer(each, each)) for each in (slope, prior.time * slope))
    shapes = (np.eye(parts), prior.elsewhere, prior.swings, sum(jitter) / 2, prior.rise)
    terms = np.stack([prior.noise, *(variance * each for each in shapes)])
    return np.asarray(scatter + count * prior.zero + np.tensordot(_points(), terms, axes=1))


def _scaled(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a covariance, (k, k), divided by its mean variance.

    A covariance of 0 is returned unchanged.
    """
    return np.asarray(covariance * (len(covariance) / max(np.trace(covariance), 1e-12)))


@dataclass(frozen=True, slots=True)
class CrossValidatedFit:
    """Weights from all passes, and estimates of all passes by cross-validation."""

    weights: NDArray[np.float64]  # weights of the features, (k,).
    # Load of each pass, (n,) in kg, estimated with weights from the deviations of the other passes.
    held_out: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PointFits:
    """Weights and held-out estimates for each point of the coefficients."""

    weights: NDArray[np.float64]  # weights of the features, (points, k)
    held_out: NDArray[np.float64]  # load of each pass in kg, (points, n)
    log_likelihoods: NDArray[np.float64]  # logarithm of the likelihood of each point, (points,)

    def averaged(self, elsewhere: Sequence['PointFits'] = ()) -> CrossValidatedFit:
        """Return the weighted mean of the fits, with more weight for more likely points.

        `elsewhere` contains the fits at the other speeds, with the same points.
        """
        logs = _OWN * self.log_likelihoods
        if elsewhere:
            logs = logs + _ELSEWHERE * np.mean([each.log_likelihoods for each in elsewhere], axis=0)
        shares = np.exp(logs - logs.max())
        shares /= shares.sum()
        return CrossValidatedFit(shares @ self.weights, shares @ self.held_out)


def point_fits(known: Evidence, prior: Prior) -> PointFits:
    """Fit weights for each point of the coefficients.

    The likelihood of a point is computed from the errors of held-out passes after a calibration of
    gain and offset.
    """
    masses, curve, residuals = known.masses, known.curve, known.residuals
    # Factor by which the residual of each pass increases if the curve is fitted to the other passes
    # instead of all passes.
    others = 1 / (1 - masses**2 / (masses @ masses))
    pairs = [held_out(each, curve, residuals, others) for each in covariances(known, prior)]
    weights, errors = (np.array(each) for each in zip(*pairs, strict=True))
    found = masses + errors
    left = [calibrate(row, masses).apply(row) - masses for row in found]
    variances = np.mean(np.square(left), axis=1) + _LEAST_VARIANCE
    return PointFits(weights, found, -len(masses) / 2 * np.log(variances))


class TunedLearned(Tunable):
    """Tuning of the learned estimator. No parameters are searched."""

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with the layout of the features, which is the same at all speeds."""
        windows = [[each.window for each in group.passes] for group in groups]
        rises = [rise_time(window) / transit(window) for row in windows for window in row]
        rise = rise_parts(float(np.median(rises)))
        gaps = [np.quantile([_gap(window) for window in row], _ALONE) for row in windows]
        gap = max(_LESS * float(min(gaps)), 0.0)
        layout = Layout(int(PARTS * min(gap, _LONGEST_LEAD)), rise, PARTS - rise)
        known = LearnedParameters(
            parts=layout.window,
            rise_parts=layout.rise,
            lead_parts=layout.lead,
            gap=float(f'{min(gap, 2 * _LONGEST_LEAD):.4f}'),
            weights=(0.0,) * layout.count,
            weights_alone=(0.0,) * layout.window,
        )
        return replace(base, identifier=base.identifier.with_set('learned', known))

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the load of each pass, (n,) in kg, estimated with weights from other passes."""
        alone, led = self._fits
        result = alone.held_out.copy()
        if led is not None:
            result[self._led] = led.held_out
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the weights for windows with and without the signal before t2.

        The weights with the signal before t2 are learned from the passes that have this signal, and
        the other weights are learned from all passes. If fewer than three passes have this signal,
        the features before t2 have the weight 0.
        """
        alone, led = self._fits
        layout = self.known.layout
        before = np.zeros(layout.count - layout.window)
        weights = np.concatenate([before, alone.weights]) if led is None else led.weights
        lists = {'weights': weights, 'weights_alone': alone.weights}
        return {f'identifier.learned.{name}': tuple(row.tolist()) for name, row in lists.items()}

    @cached_property
    def _led(self) -> NDArray[np.bool_]:
        """Mask of the passes in which the signal before t2 is used, (n,) bool."""
        return _is_led(self.group, self.known)

    @cached_property
    def _fits(self) -> tuple[CrossValidatedFit, CrossValidatedFit | None]:
        """Fit to the features after t2, and fit to all features.

        The second fit is None if the signal before t2 is used in fewer than three passes.
        """
        groups = [self.group, *self.others]
        tunables = [TunedLearned(self.name, each, self.base, groups) for each in self.others]
        (alone, led), elsewhere = self._point_fits, [each._point_fits for each in tunables]
        return (
            alone.averaged([each for each, _ in elsewhere]),
            led.averaged([each for _, each in elsewhere if each]) if led else None,
        )

    @cached_property
    def _point_fits(self) -> tuple[PointFits, PointFits | None]:
        """Fits to the features after t2, and fits to all features, as in `_fits`."""
        layout = self.known.layout
        prior = self._prior(layout)
        alone = _evidence(self.group, Layout(0, 0, layout.window))
        led = None
        if np.count_nonzero(self._led) >= _FEWEST:
            led = point_fits(_evidence(self.group, layout).select(self._led), prior)
        return point_fits(alone, prior.last(layout.window)), led

    def _prior(self, layout: Layout) -> Prior:
        from scipy.linalg import toeplitz  # imported late, because the import is slow

        elsewhere = np.zeros((layout.count, layout.count))
        for group in self.others:
            led = _is_led(group, self.known)
            if np.count_nonzero(led) >= _FEWEST:
                scatter = _evidence(group, layout).select(led).scatter
                variance = np.trace(scatter) / layout.count / np.count_nonzero(led)
                elsewhere += scatter / max(variance, _LEAST_VARIANCE)
        windows = [each.window for each in self.group.passes]
        noise = toeplitz(empty_belt_covariances(windows, layout, self.base.segmenter.settle_time))
        time = np.maximum(np.arange(layout.count) - layout.lead + 0.5, 0.0)
        deviations = [each.zero_std_dev / each.counts_per_kg for each in windows]
        zero = float(np.mean(np.square(deviations)))
        duration = float(np.median([transit(window) for window in windows])) / PARTS
        swings, rise = swing_covariance(layout, duration), rise_covariance(layout)
        return Prior(noise, elsewhere, swings, rise, time, _ZERO * _ZERO * zero)


def swing_covariance(layout: Layout, duration: float) -> NDArray[np.float64]:
    """Return the covariance of damped swings that begin during the entry or at t2, (k, k).

    The mean variance is 1, and the phase of a swing is random. `duration` is the duration in s of
    the part of the signal that gives one feature.
    """
    place = np.arange(layout.count) - layout.lead + 0.5
    result = np.zeros((layout.count, layout.count))
    for beginning in _BEGINNINGS:
        time = (place - beginning * layout.rise) * duration
        begun = np.maximum(time, 0.0)
        fading = np.where(time >= 0, np.exp(-begun / _DECAYS[:, np.newaxis]), 0.0)
        turns = 2 * np.pi * _SWINGS * np.subtract.outer(begun, begun)[..., np.newaxis]
        result += (fading.T @ fading) * np.cos(turns).mean(axis=-1)
    return _scaled(result)


def rise_covariance(layout: Layout) -> NDArray[np.float64]:
    """Return the covariance of a Brownian bridge from t1 to t2, (k, k), with mean variance 1."""
    share = np.clip((np.arange(layout.count) - layout.lead + 0.5) / max(layout.rise, 1), 0.0, 1.0)
    return _scaled(np.minimum.outer(share, share) - np.outer(share, share))


def empty_belt_covariances(
    windows: Sequence[WeighWindow], layout: Layout, settle_time: float
) -> NDArray[np.float64]:
    """Return the autocovariance of features of the empty belt, (layout.count,) in kg^2.

    The mean is not subtracted, because an error of the zero counts as noise. The autocovariance is
    0 for lags that are longer than the recorded signals of the empty belt.
    """
    segments = []
    for window in windows:
        part = transit(window) / (layout.rise + layout.window)
        lead = int((seconds_alone(window) - settle_time) / part)
        if lead >= 1:
            segments.append(pass_features(window, Layout(lead, layout.rise, layout.window))[:lead])
    return pooled_autocovariance(segments, layout.count)


def _evidence(group: SpeedGroup, layout: Layout) -> Evidence:
    features = np.array([pass_features(each.window, layout) for each in group.passes])
    return Evidence(features, group.masses)


def _is_led(group: SpeedGroup, known: LearnedParameters) -> NDArray[np.bool_]:
    least = max(known.gap, known.layout.lead_span)
    return np.array([_gap(each.window) >= least for each in group.passes])


def _gap(window: WeighWindow) -> float:
    """Return the time from the exit of the previous item to t1, as a multiple of t3 - t1."""
    return seconds_alone(window) / transit(window)
