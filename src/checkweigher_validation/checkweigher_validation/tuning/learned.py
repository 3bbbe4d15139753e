# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Tuning of the learned estimator: the covariance of the signal of a pass about its load.

.. math:: C = R'R + a n N + b \sigma^2 I + c \sum_o \frac{\sigma^2}{\sigma_o^2} R_o'R_o
   + n (d d' + z^2 1 1')

R are the residuals of the n passes of a speed from the mean curve, and :math:`\sigma^2` the mean of
their variances. The other terms come from other signals or are assumed, and dominate with few
passes: the noise N of the empty belt, white noise, the residuals :math:`R_o` of the other speeds at
the same places of the belt, the curve d by which a heavier product rings slower, and the error z of
the zero, which successive passes share and therefore hardly show.
The coefficients a to c are averaged over a grid, each point weighted by the likelihood of held-out
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

_LONGEST_LEAD = 0.75  # as a multiple of t3 - t1
_ALONE = 0.02  # share of the training passes that may have less than the gap
_LESS = 0.95  # share of that gap that suffices in production
_FEWEST = 3  # passes from which weights are learned
_FOLDS = 8
_SLOWER = 0.01  # largest relative difference of the ringing frequency between products
_ZERO = 2.0  # z, as a multiple of the standard deviation that the segmenter states
_LEAST_VARIANCE = 1e-18  # kg^2
# a, b and c.
_SHARES = tuple(product((0.0, 0.03, 0.3, 3.0), (0.01, 0.1, 1.0, 10.0), (0.0, 0.1, 1.0)))


@dataclass(frozen=True, slots=True)
class Evidence:
    """Features (n, k) of the passes of one speed, and their `masses` (n,), both in kg."""

    features: NDArray[np.float64]
    masses: NDArray[np.float64]

    def select(self, rows: NDArray[np.bool_]) -> 'Evidence':
        """Return some of the passes."""
        return Evidence(self.features[rows], self.masses[rows])

    @property
    def curve(self) -> NDArray[np.float64]:
        """Mean curve of a load of 1, (k,)."""
        return np.asarray(self.masses @ self.features / (self.masses @ self.masses))

    @property
    def scatter(self) -> NDArray[np.float64]:
        """R'R, (k, k), kg^2."""
        residuals = self.features - np.outer(self.masses, self.curve)
        return np.asarray(residuals.T @ residuals)


@dataclass(frozen=True, slots=True)
class Prior:
    """Knowledge from sources other than the passes of a speed."""

    noise: NDArray[np.float64]  # (k, k), kg^2, of the empty belt
    elsewhere: NDArray[np.float64]  # (k, k), residuals of other speeds, each of variance 1
    time: NDArray[np.float64]  # (k,), since t1, in parts
    zero: float = 0.0  # kg^2, variance of an error that all parts share

    def last(self, count: int) -> 'Prior':
        """Return the prior of only the last parts."""
        end = slice(-count, None)
        return Prior(self.noise[end, end], self.elsewhere[end, end], self.time[end], self.zero)


def weights_by_share(known: Evidence, prior: Prior) -> NDArray[np.float64]:
    """Return the weights for each point of the grid, (points, k), with a gain of 1."""
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
    """Weights (k,), and estimates of the passes by weights from other passes, (n,) kg."""

    weights: NDArray[np.float64]
    held_out: NDArray[np.float64]


def fit(known: Evidence, prior: Prior) -> CrossValidatedFit:
    """Learn weights, averaged over the grid by the likelihood of held-out passes."""
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
    """Learned estimator. Nothing is searched; all parameters follow by least squares."""

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with the layout of the parts, which is the same at all speeds."""
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
        """Return the load of every pass by weights from the other passes."""
        alone, led = self._fits
        result = alone.held_out.copy()
        if led is not None:
            result[self._led] = led.held_out
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the weights from all passes."""
        alone, led = self._fits
        layout = self.known.layout
        before = np.zeros(layout.count - layout.window)
        weights = np.concatenate([before, alone.weights]) if led is None else led.weights
        lists = {'weights': weights, 'weights_alone': alone.weights}
        return {f'identifier.learned.{name}': tuple(row.tolist()) for name, row in lists.items()}

    @cached_property
    def _led(self) -> NDArray[np.bool_]:
        """Whether the signal before t2 is used, by pass, (n,) bool."""
        return _is_led(self.group, self.known)

    @cached_property
    def _fits(self) -> tuple[CrossValidatedFit, CrossValidatedFit | None]:
        """Return the fit of the parts from t2 on, and the fit of all parts if there is one."""
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
    """Return the covariances, (layout.count,) kg^2, of parts of the empty belt by their distance.

    They are computed about 0, not about the mean, because an error of the zero counts as noise. A
    covariance is 0 if the empty belt was recorded too briefly for its distance.
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
    """Return the time since the previous item left, as a multiple of t3 - t1."""
    return seconds_alone(window) / transit(window)
