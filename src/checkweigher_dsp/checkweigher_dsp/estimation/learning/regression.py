# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
r"""Learning of the weights of the parts of a pass from items of unknown mass.

.. math:: m = \sum_j w_j y_j,\quad w \propto C^{-1} s,\quad C = R'R / d + a N + b v I + c v P

Items of about the same mass form a cluster. The differences between the passes of a cluster are
mainly disturbance. R contains the deviations of the parts y from the means of the clusters, and d
is the number of degrees of freedom. v is the mean variance that remains in R after the curve s of a
load of 1, times the deviation of each load, is subtracted. Differences between the masses in a
cluster add a multiple of s s' to C, which does not change the weights. With few items, R'R / d is
an inaccurate estimate of the covariance. So C also contains the covariances N of the empty belt, I
of white noise, and P of the ringing of a platform. The weights are computed for a grid of a, b and
c. The result is the average of the weights over the grid, weighted by the likelihood of the
held-out masses (own derivation, see docs/method.md). The mass of an item is held out if it is
computed with the weights that are learned from the other items.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.settings_files import Settings
from checkweigher_dsp.estimation.estimators.learned import PARTS
from checkweigher_dsp.estimation.learning.passage import MOST_LEAD, PassParts
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.autoregression import pooled_autocovariance

# Grid of a, b and c.
_SHARES = tuple(product((0.03, 0.3, 3.0), (0.003, 0.03, 0.3), (0.0, 0.1, 1.0)))
# Coefficients a, b and c of the plain weights, which are computed from C without the term R'R / d.
_PLAIN = (0.3, 0.03, 0.1)
_FEWEST = 15  # smallest number of degrees of freedom from which weights are learned
_ALONE = 0.05  # fraction of items that may have fewer parts before t1 than the weights
_APART = 0.02  # smallest distance between clusters as a fraction of the median load
_APART_STD_DEVS = 6.0  # smallest distance between clusters in standard deviations of the estimator.
# Weights are trusted if the standard deviation of held-out masses is below `_GAIN` times the
# standard deviation of the masses by the selected estimator. If the masses of the products differ
# much, held-out masses may scatter less by chance, so the factor is then `_GAIN_OF_DIFFERENT`.
_GAIN, _GAIN_OF_DIFFERENT = 0.95, 0.8
# Largest ratio of two standard deviations for products of similar mass: of the masses by the
# selected estimator, and of their differences from the masses by plain weights. The true mass
# cancels in the difference of two estimates.
_ALIKE = 0.8
# Number of degrees of freedom that learning uses. The variance of held-out masses is increased
# accordingly, because the weights and the likelihoods of the grid are learned from the same items.
_LEARNED = 5.0
_PLATFORMS = np.geomspace(15.0, 60.0, 24)  # natural frequencies of platforms in Hz
_DAMPING = 0.05  # damping ratio of platforms
_FADING = 0.1  # decay time of ringing in s
_ROUNDING = 1e-6  # largest error of the weighted sum for a load of 1
_LEAST_VARIANCE = 1e-18  # smallest variance in kg^2, and smallest standard deviation in kg


@dataclass(frozen=True, eq=False)
class Fit(Settings):
    """Weights that were learned from items of one belt speed and length.

    `curve`, `weights` and `noise`, (k,) each, contain a value for each of the last k parts of a
    pass: the signal of a load of 1, the weight of the part in the mass, and the standard deviation
    of the residual in kg. `spectrum`, (k // 2 + 1,), is the median power of the residuals in kg^2
    at each frequency. Raises `SettingsError` if the lengths of the arrays do not match, or if the
    weighted sum of `curve` is not 1.
    """

    curve: Array = parameter(text='parts of the signal of a load of 1')
    weights: Array = parameter(text='weights of the parts in the mass')
    noise: Array = parameter(text='standard deviation of each part', unit='kg', minimum=0)
    spectrum: Array = parameter(text='power of the residuals', unit='kg^2', minimum=0)
    variance: float = parameter(text='variance of held-out masses', unit='kg^2', minimum=0)
    variance_before: float = parameter(
        text='variance of the masses by the selected estimator', unit='kg^2', minimum=0
    )
    zero_variance: float = parameter(text='mean variance of the zero', unit='kg^2', minimum=0)
    loads: tuple[float, float] = parameter(text='smallest and largest load', unit='kg', minimum=0)
    items: int = parameter(text='number of items that were learned from, including the unused ones')
    trusted: bool = parameter(
        text='whether the learned weights are more precise than the selected estimator'
    )

    def __post_init__(self) -> None:
        count = len(self.weights)
        lengths = [len(each) for each in (self.curve, self.noise, self.spectrum)]
        if count < PARTS or lengths != [count, count, count // 2 + 1]:
            raise SettingsError(
                f'{count} weights do not match the lists, whose lengths are {lengths}', 'weights'
            )
        mass = self.weights @ self.curve
        if abs(mass - 1) > _ROUNDING:
            raise SettingsError(
                f'the mass of a load of 1 is {mass:g}, not 1: the file is damaged', 'weights'
            )

    @property
    def lead(self) -> int:
        """Number of parts before t1."""
        return len(self.weights) - PARTS

    def residual(self, passage: PassParts) -> Array:
        """Return the last k parts of a pass minus the parts that its mass explains, (k,) in kg."""
        return passage.parts[-len(self.weights) :] - self.mass(passage) * self.curve

    def mass(self, passage: PassParts) -> float:
        """Return the mass of an item in kg, which is the weighted sum of the last k parts."""
        return float(np.add.reduce(self.weights * passage.parts[-len(self.weights) :]))


def fit(passages: Sequence[PassParts], rise: int) -> Fit | None:
    """Learn weights from the passes of items. Returns None if too few masses are similar.

    `rise` is the number of parts from t1 to t2. Up to 5 % of the passes are used only for the
    covariance of the empty belt, if they have fewer parts before t1 than the others.
    """
    lead = min(int(np.quantile([each.lead for each in passages], _ALONE)), MOST_LEAD)
    used = [each for each in passages if each.lead >= lead]
    parts = np.array([each.parts[-lead - PARTS :] for each in used])
    loads = np.array([each.load for each in used])
    deviation = float(np.median(np.sqrt([each.variance for each in used])))
    clusters = _clusters(loads, max(_APART * float(np.median(loads)), _APART_STD_DEVS * deviation))
    freedom = len(used) - len(np.unique(clusters))
    if freedom < _FEWEST:
        return None
    duration = float(np.median([each.duration for each in used]))
    noise = _empty_belt_covariance(passages, lead + PARTS)
    found = _Items(parts, loads, clusters, freedom, noise, _ringing(lead, rise, duration))
    weights, held_out = found.learn()
    before = found.deviations * found.others
    plain = found.deviations - found.within @ found.plain_weights()
    alike = found.rms(before) < _ALIKE * float(np.sqrt(plain @ plain / freedom))
    ratio = found.rms(held_out) / max(found.rms(before), _LEAST_VARIANCE)
    residuals = parts - np.outer(np.add.reduce(weights * parts, axis=1), found.curve)
    return Fit(
        curve=found.curve,
        weights=weights,
        noise=np.sqrt(np.mean(np.square(residuals), axis=0)),
        spectrum=usual_power(residuals),
        variance=found.rms(held_out) ** 2 * (freedom + _LEARNED) / freedom,
        variance_before=found.rms(before) ** 2,
        zero_variance=float(np.mean([each.zero_variance for each in used])),
        loads=(float(loads.min()), float(loads.max())),
        items=len(passages),
        trusted=ratio < (_GAIN if alike else _GAIN_OF_DIFFERENT),
    )


def usual_power(residuals: Array) -> Array:
    """Return the median power of n Hann-weighted residuals (n, k) by frequency, (k // 2 + 1,)."""
    taper = np.hanning(residuals.shape[1] + 2)[1:-1]
    spectra = np.fft.rfft(residuals * (taper / np.sqrt(taper @ taper)))
    return np.asarray(np.median(spectra.real**2 + spectra.imag**2, axis=0))


def held_out(covariance: Array, curve: Array, within: Array, others: Array) -> tuple[Array, Array]:
    """Return the weights, (k,), and the held-out error of each item, (n,).

    A held-out error is computed with the weights that are learned from the other items. `curve`,
    (k,), is s. A row r of `within`, (n, k), is the deviation of an item from the mean of its
    cluster. The deviation of the item from the mean of the other items is o r, with o from
    `others`, (n,). `covariance` C, (k, k), contains R'R of all rows. If an item is omitted, R'R
    decreases by o r r'. By the formula of Sherman and Morrison, C^-1 s then increases by
    t (r' C^-1 s) C^-1 r with t = o / (1 - o r' C^-1 r). The held-out error is o r' w with the
    resulting weights w.
    """
    solved = np.linalg.solve(covariance, np.column_stack([curve, within.T]))
    for_curve, for_items = solved[:, 0], solved[:, 1:]  # C^-1 s and C^-1 r
    gain = curve @ for_curve  # s' C^-1 s
    along = within @ for_curve  # r' C^-1 s
    leverage = np.einsum('ij,ji->i', within, for_items)  # r' C^-1 r
    times = others / np.maximum(1 - others * leverage, 1e-9)
    errors = others * along * (1 + times * leverage) / (gain + times * along * along)
    return for_curve / gain, errors


class _Items:
    """Items in clusters of about the same mass.

    `parts`, (n, k), are the parts of the passes, and `loads`, (n,), the loads by the estimator,
    both in kg. `clusters`, (n,), contains the number of the cluster of each item, and `freedom` is
    the number of degrees of freedom. `noise` and `ringing`, (k, k), are the covariances N and P.
    """

    def __init__(
        self,
        parts: Array,
        loads: Array,
        clusters: NDArray[np.int_],
        freedom: int,
        noise: Array,
        ringing: Array,
    ) -> None:
        sizes = np.bincount(clusters)[clusters]
        means = np.bincount(clusters, loads)[clusters] / sizes
        self._freedom = freedom
        # For each item, the deviation from the mean of the other items of its cluster, divided by
        # the deviation from the mean of the whole cluster.
        self.others = np.where(sizes > 1, sizes / np.maximum(sizes - 1, 1), 0.0)
        self._counts = (sizes - 1) / sizes
        self.curve = np.asarray(means @ parts / (means @ means))
        self.deviations = loads - means
        centres = np.array([parts[clusters == n].mean(axis=0) for n in range(clusters.max() + 1)])
        self.within = parts - centres[clusters]
        beside = self.within - np.outer(self.deviations, self.curve)
        self._variance = max(float(np.mean(np.square(beside))), _LEAST_VARIANCE)
        self._scatter = self.within.T @ self.within
        self._noise, self._ringing = noise, ringing

    def rms(self, errors: Array) -> float:
        """Return the standard deviation of held-out errors, (n,), within the clusters."""
        return float(np.sqrt(np.square(errors) @ self._counts / self._freedom))

    def plain_weights(self) -> Array:
        """Return the plain weights, (k,), for C without the term R'R / d and with `_PLAIN`."""
        weights = np.linalg.solve(self._prior(_PLAIN), self.curve)
        return np.asarray(weights / (weights @ self.curve))

    def learn(self) -> tuple[Array, Array]:
        """Return the weights, (k,), and the held-out errors of the items in kg, (n,)."""
        found = [
            held_out(self._prior(each) + self._scatter, self.curve, self.within, self.others)
            for each in _SHARES
        ]
        weights, errors = (np.array(each) for each in zip(*found, strict=True))
        deviations = np.array([self.rms(row) for row in errors]) + _LEAST_VARIANCE
        likelihoods = (deviations.min() / deviations) ** self._freedom
        counts = likelihoods / likelihoods.sum()
        return counts @ weights, counts @ errors

    def _prior(self, shares: tuple[float, float, float]) -> Array:
        belt, white, ringing = shares
        own = white * np.eye(len(self.curve)) + ringing * self._ringing
        return np.asarray(self._freedom * (belt * self._noise + self._variance * own))


def _clusters(loads: Array, width: float) -> NDArray[np.int_]:
    """Return the number of the cluster that contains each load, (n,). The first number is 0.

    A gap between successive loads that is wider than `width` in kg separates two clusters.
    """
    order = np.argsort(loads, kind='stable')
    result = np.empty(len(loads), dtype=np.int_)
    result[order] = np.append(0, np.cumsum(np.diff(loads[order]) > width))
    return result


def _empty_belt_covariance(passages: Sequence[PassParts], count: int) -> Array:
    """Return the covariance of parts of the empty belt in kg^2, (count, count).

    The mean of the parts is not subtracted, so that the covariance includes the error of the zero.
    The covariance is 0 at lags of at least the length of the longest segment of the empty belt.
    """
    segments = (each.parts[each.lead - each.quiet : each.lead] for each in passages)
    places = np.arange(count)
    return pooled_autocovariance(segments, count)[abs(np.subtract.outer(places, places))]


def _ringing(lead: int, rise: int, duration: float) -> Array:
    """Return the covariance of the ringing of a platform, (k, k), scaled to a mean variance of 1.

    The amplitude of the ringing is largest while a product enters. Before the entry, and long after
    it, the amplitude is half as large.
    """
    time = (np.arange(lead + PARTS) - lead + 0.5) * duration
    fading = np.exp(-np.maximum(time - rise * duration, 0.0) / _FADING)
    envelope = np.where(time < 0, 0.5, 0.5 + 0.5 * fading)
    turns = 2 * np.pi * _PLATFORMS * abs(np.subtract.outer(time, time))[..., np.newaxis]
    swing = np.mean(np.cos(turns) * np.exp(-_DAMPING * turns), axis=-1)
    result = swing * np.outer(envelope, envelope)
    return np.asarray(result * (len(time) / np.trace(result)))
