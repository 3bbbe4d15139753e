# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Tuning of the learned estimator: the covariance of the signal of a pass about its load.

.. math:: C = R'R + a n N + b \sigma^2 I + c \sum_o \frac{\sigma^2}{\sigma_o^2} R_o'R_o
   + n (d d' + z^2 1 1')

R has the residuals of the n passes of a speed from their mean curve, and :math:`\sigma^2` is the
mean of the variances of R. The other terms dominate if there are few passes: the covariance N of
the noise of the empty belt; white noise; the residuals :math:`R_o` of each other speed at the same
positions on the belt, with the mean variance :math:`\sigma_o^2`; the change d of the curve for a
heavier product, whose oscillation is slower; and the standard deviation z of the zero, whose error
is nearly equal in successive passes and thus not visible in R. The weights are averaged over a grid
of the coefficients a, b and c. Each point of the grid is weighted by the likelihood of held-out
passes. [own derivation]
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import toeplitz

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
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.autoregression import pooled_autocovariance
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import are_distinct, calibrate, folds
from checkweigher_validation.tuning.tunables import Tunable

_LONGEST_LEAD = 0.75  # longest used signal before t1, as a multiple of t3 - t1
_ALONE = 0.02  # fraction of the training passes that may have a shorter gap before the product
_LESS = 0.95  # ratio of the gap that is required in production to that of the training passes
_FEWEST = 3  # smallest number of passes from which weights are learned
_FOLDS = 8
_SLOWER = 0.01  # assumed relative difference of the natural frequency between products
_ZERO = 2.0  # ratio of z to the standard deviation of the zero that the segmenter states
_LEAST_VARIANCE = 1e-18  # smallest variance in kg^2.
# Grid of the coefficients a, b and c.
_SHARES = tuple(product((0.0, 0.03, 0.3, 3.0), (0.01, 0.1, 1.0, 10.0), (0.0, 0.1, 1.0)))


@dataclass(frozen=True, slots=True)
class Evidence:
    """Features and true masses of the passes of one speed."""

    features: NDArray[np.float64]  # (n, k), in kg
    masses: NDArray[np.float64]  # (n,), in kg

    def select(self, rows: NDArray[np.bool_]) -> 'Evidence':
        """Return the passes `rows`."""
        return Evidence(self.features[rows], self.masses[rows])

    @property
    def curve(self) -> NDArray[np.float64]:
        """Mean features of a pass per mass, (k,)."""
        return np.asarray(self.masses @ self.features / (self.masses @ self.masses))

    @property
    def scatter(self) -> NDArray[np.float64]:
        """Product R'R of the residuals, (k, k), in kg^2."""
        residuals = self.features - np.outer(self.masses, self.curve)
        return np.asarray(residuals.T @ residuals)


@dataclass(frozen=True, slots=True)
class Prior:
    """Terms of the covariance that do not depend on the passes of the speed."""

    noise: NDArray[np.float64]  # covariance of the noise of the empty belt, (k, k), in kg^2
    elsewhere: NDArray[np.float64]  # normalized sum of R_o'R_o over the other speeds, (k, k)
    time: NDArray[np.float64]  # time of each feature since t1, (k,), in features
    zero: float = 0.0  # variance z^2 of the zero in kg^2

    def last(self, count: int) -> 'Prior':
        """Return the terms of the last `count` features."""
        end = slice(-count, None)
        return Prior(self.noise[end, end], self.elsewhere[end, end], self.time[end], self.zero)


def weights_by_share(known: Evidence, prior: Prior) -> NDArray[np.float64]:
    """Return the weights for each point of the grid, (points, k). Their gain is 1."""
    count, curve, scatter = len(known.masses), known.curve, known.scatter
    parts = len(curve)
    variance = max(float(np.trace(scatter)) / parts / count, _LEAST_VARIANCE)
    if not are_distinct(known.masses):
        drawl = _SLOWER * float(known.masses.mean()) * prior.time * np.gradient(curve)
        scatter = scatter + count * np.outer(drawl, drawl)
    scatter = scatter + count * prior.zero
    a, b, c = np.array(_SHARES).T[..., np.newaxis, np.newaxis]
    covariances = scatter + a * count * prior.noise
    covariances += variance * (b * np.eye(parts) + c * prior.elsewhere)
    weights = np.linalg.solve(covariances, curve[:, np.newaxis])[..., 0]
    return np.asarray(weights / (weights @ curve)[:, np.newaxis])


@dataclass(frozen=True, slots=True)
class CrossValidatedFit:
    """Weights from all passes, and estimates of all passes by cross-validation."""

    weights: NDArray[np.float64]  # (k,)
    held_out: NDArray[np.float64]  # estimate of each pass by weights from other passes, (n,) in kg


def fit(known: Evidence, prior: Prior) -> CrossValidatedFit:
    """Return weights that are averaged over the grid by the likelihood of held-out passes."""
    fold = folds(known.masses, _FOLDS)
    found = np.empty((len(_SHARES), len(known.masses)))
    for number in np.unique(fold):
        out = fold == number
        taught = known.select(~out) if not out.all() else known
        found[:, out] = weights_by_share(taught, prior) @ known.features[out].T
    errors = [calibrate(row, known.masses).apply(row) - known.masses for row in found]
    deviations = np.sqrt(np.mean(np.square(errors), axis=1) + _LEAST_VARIANCE)
    likelihoods = (deviations.min() / deviations) ** len(known.masses)
    shares = likelihoods / likelihoods.sum()
    return CrossValidatedFit(shares @ weights_by_share(known, prior), shares @ found)


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
        """Return the estimated load of each pass by weights from other passes, (n,) in kg."""
        alone, led = self._fits
        result = alone.held_out.copy()
        if led is not None:
            result[self._led] = led.held_out
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the weights that are learned from all passes."""
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
        """Return the fit to the features after t2, and the fit to all features or None."""
        layout = self.known.layout
        prior = self._prior(layout)
        alone = fit(_evidence(self.group, Layout(0, 0, layout.window)), prior.last(layout.window))
        if np.count_nonzero(self._led) < _FEWEST:
            return alone, None
        return alone, fit(_evidence(self.group, layout).select(self._led), prior)

    def _prior(self, layout: Layout) -> Prior:
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
        return Prior(noise, elsewhere, time, _ZERO * _ZERO * zero)


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
