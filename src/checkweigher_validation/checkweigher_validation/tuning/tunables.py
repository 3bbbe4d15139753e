# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tunable parameters of each estimator, and the masses that follow for all passes at once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser, denoise_batch
from checkweigher_dsp.denoising.window_batch import batches_of
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.estimators.aeksi import identify_adaptive_by_ekf
from checkweigher_dsp.estimation.estimators.aid import AdaptiveSettings, identify_adaptive
from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.fir_model import fir_weights, fit_fir
from checkweigher_dsp.estimation.estimators.iswd_eksi import identify_passes
from checkweigher_dsp.estimation.estimators.tvlpf import decay_of, lowpass_weights
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.extended_kalman import Noise
from checkweigher_dsp.signal.platform_poles import is_stable
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.calibration import folds
from checkweigher_validation.tuning.search import Axis, Values, search

_FOLDS = 5


class TuningError(ValueError):
    """Passes that an estimator cannot be tuned on; the message says what is missing."""


def estimates_of(group: SpeedGroup, parameters: LineParameters) -> NDArray[np.float64]:
    """Return the loads of passes by the chosen estimator, (n,) float64, kg, before the gain."""
    identifier = parameters.identifier
    estimator = ESTIMATORS[identifier.estimator](identifier.chosen)
    windows = [each.window for each in group.passes]
    if estimator.needs_denoised:
        windows = Denoiser(parameters.denoise).denoise_all(windows)
    return np.array([load.mass for load in estimator.estimate_all(windows)])


class Tunable:
    """An estimator on the passes of one belt speed; `axes` are its parameters that are searched.

    `base` has everything that is not tuned at one speed alone; `others` are the passes of the other
    speeds.
    """

    name: ClassVar[str]
    axes: ClassVar[tuple[Axis, ...]] = ()

    def __init__(
        self, group: SpeedGroup, base: LineParameters, others: Sequence[SpeedGroup] = ()
    ) -> None:
        self.group = group
        self.base = base
        self.others = others
        self.sample_rate = group.passes[0].window.sample_rate
        samples = [raw_samples(each.window) for each in group.passes]
        lengths = np.array([len(window) for window in samples])
        # Windows of one length are computed together.
        self.batches = []
        for length in np.unique(lengths):
            rows = np.flatnonzero(lengths == length)
            self.batches.append((rows, np.stack([samples[row] for row in rows])))

    def of_windows(
        self, kernel: Callable[[NDArray[np.float64]], NDArray[np.float64]]
    ) -> NDArray[np.float64]:
        """Return the results, (n,), of a kernel that takes windows of one length, (k, n)."""
        result = np.empty(len(self.group.passes))
        for rows, samples in self.batches:
            result[rows] = kernel(samples)
        return result

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the load of every pass, before gain and offset: (n,) float64, kg.

        Unless overridden, by the estimator as it is in `base`: nothing is tuned.
        """
        return estimates_of(self.group, self.base.with_estimator(self.name))

    @classmethod
    def prepare(cls, groups: Sequence[SpeedGroup], base: LineParameters) -> LineParameters:
        """Return `base` with the parameters that all speeds together teach; here none."""
        return base

    def search(
        self, badness: Callable[[Mapping[str, float]], float], budget: int
    ) -> tuple[Values, float]:
        """Return the best values and their badness."""
        axes = [replace(axis, start=self.start(axis)) for axis in self.searched()]
        return search(axes, badness, budget)

    def searched(self) -> tuple[Axis, ...]:
        """Return the axes of the search from the values of `base` on."""
        return self.axes

    def start(self, axis: Axis) -> float:
        """Return the value of `base` at this speed, where the search starts."""
        known = getattr(self.base.identifier, self.name)
        return known.at(axis.name, self.group.speed) if hasattr(known, axis.name) else axis.start

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the lists of parameters at this speed, by their name with that of the node."""
        return {f'identifier.{self.name}.{name}': (value,) for name, value in values.items()}


class TunedMean(Tunable):
    """The mean: nothing to tune."""

    name = 'mean'


class TunedHann(Tunable):
    """The Hann-weighted mean: nothing to tune."""

    name = 'hann'


class TunedIswdEksiPaper(Tunable):
    """The paper's literal form: Table 1 is as it is printed."""

    name = 'iswd_eksi_paper'


class TunedTvlpf(Tunable):
    """The time-varying low-pass filter: its order and the schedule of its cut-off."""

    name = 'tvlpf'
    axes = (
        Axis('sections', 2, 4, 2, whole=True),
        Axis('initial_cutoff', 2.0, 400.0, 50.0, logarithmic=True),
        Axis('final_cutoff', 0.1, 30.0, 3.0, logarithmic=True),
        Axis('half_life', 0.02, 2.0, 0.1, logarithmic=True),
    )

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the last output of the filter for every window."""

        def output(samples: NDArray[np.float64]) -> Any:
            count = samples.shape[1]
            weights = lowpass_weights(
                count, round(values['sections']), values['initial_cutoff'],
                values['final_cutoff'], decay_of(values['half_life'], count), self.sample_rate,
            )  # fmt: skip
            return np.sum(samples * weights, axis=-1)

        return self.of_windows(output)


class TunedAid(Tunable):
    """AID: its prefilter."""

    name = 'aid'
    axes = (
        Axis('iterations', 1, 5, 2, whole=True),
        Axis('max_order', 0, 5, 2, whole=True),
        Axis('lowpass_cutoff', 100.0, 480.0, 480.0, logarithmic=True),
    )

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the steady state that least squares identify in every window."""
        settings = _settings(values)
        return self.of_windows(
            lambda samples: identify_adaptive(samples, settings, self.sample_rate).gain
        )


class TunedAeksi(Tunable):
    """AEKSI: its prefilter, and the noise that its filter reckons with."""

    name = 'aeksi'
    axes = (
        *TunedAid.axes,
        Axis('measurement_noise', 1e-2, 10.0, 1.0, logarithmic=True),
        Axis('process_noise', 1e-3, 300.0, 0.1, logarithmic=True),
        Axis('coefficient_variance', 1e-6, 10.0, 1.0, logarithmic=True),
    )

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the steady state that the EKF identifies in every window."""
        noise = Noise(
            values['measurement_noise'], values['process_noise'], values['coefficient_variance']
        )
        settings = _settings(values)
        rate = self.sample_rate
        return self.of_windows(
            lambda samples: identify_adaptive_by_ekf(samples, settings, noise, rate).gain
        )


def _settings(values: Mapping[str, float]) -> AdaptiveSettings:
    return AdaptiveSettings(
        round(values['iterations']), round(values['max_order']), values['lowpass_cutoff']
    )


class TunedFirModel(Tunable):
    """The FIR model: how smooth its weights are; the weights follow by least squares."""

    name = 'fir_model'
    axes = (Axis('ridge', 1e-6, 10.0, 1e-3, logarithmic=True),)

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the load of every pass by weights that the others have taught."""
        result = np.empty(len(self.group.passes))
        fold = folds(self.group.masses, _FOLDS)
        for number in np.unique(fold):
            others = np.flatnonzero(fold != number)
            # One pass alone teaches no weights.
            chosen = others if len(others) > 1 else np.arange(len(result))
            curve = self._fit(chosen, values['ridge'])
            for rows, samples in self.batches:
                out = fold[rows] == number
                weights = fir_weights(curve, samples.shape[1])
                result[rows[out]] = np.sum(samples[out] * weights, axis=-1)
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the curve that all passes teach."""
        curve = self._fit(np.arange(len(self.group.passes)), values['ridge'])
        return {'identifier.fir_model.weights': tuple(float(f'{value:.7g}') for value in curve)}

    def _fit(self, chosen: NDArray[np.intp], ridge: float) -> NDArray[np.float64]:
        windows = [raw_samples(self.group.passes[number].window) for number in chosen]
        knots = self.base.identifier.fir_model.knots
        return fit_fir(windows, self.group.masses[chosen], knots, ridge)


_BANDS = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
_THRESHOLD_FACTOR = 1000.0  # how far below and above the start a threshold is looked for
_PLATFORM = ('natural_frequency', 'damping_ratio')


class TunedIswdEksi(Tunable):
    """ISWD-EKSI: those of its parameters that matter, as measured in docs/method.md.

    Band 5 and thresholds are searched where the table of `base` has them, as Table 1 has; where it
    has none they stay off. R, Q and P0 stay as they are.
    """

    name: ClassVar[str] = 'iswd_eksi'
    axes: ClassVar[tuple[Axis, ...]] = (
        Axis('gamma6', 0.0, 1.2, 0.1),
        Axis('gamma7', 0.0, 1.2, 0.5),
        Axis('natural_frequency', 15.0, 120.0, 38.0, logarithmic=True),
        Axis('damping_ratio', 0.01, 0.5, 0.06, logarithmic=True),
        Axis('rise_noise', 1.0, 100.0, 3.0, logarithmic=True),
    )

    def __init__(
        self, group: SpeedGroup, base: LineParameters, others: Sequence[SpeedGroup] = ()
    ) -> None:
        super().__init__(group, base, others)
        windows = [each.window for each in group.passes]
        self._batches = batches_of(windows, base.denoise.stretch)

    def searched(self) -> tuple[Axis, ...]:
        """Return the axes, those of band 5 and of thresholds that the table has among them."""
        found = list(self.axes)
        for name in ('gamma5', 'lambda5', 'lambda6', 'lambda7'):
            at_speed = self.start(Axis(name, 0.0, 0.0, 0.0))
            if at_speed > 0 and name == 'gamma5':
                found.append(Axis(name, 0.0, 1.2, at_speed))
            elif at_speed > 0:
                low, high = at_speed / _THRESHOLD_FACTOR, at_speed * _THRESHOLD_FACTOR
                found.append(Axis(name, low, high, at_speed, logarithmic=True))
        return tuple(found)

    def start(self, axis: Axis) -> float:
        """Return the value of `base` at this speed, for denoise as well."""
        known = self.base.denoise
        if not hasattr(known, axis.name):
            return super().start(axis)
        column = getattr(known, axis.name)
        return float(np.interp(self.group.speed, known.speeds[: len(column)], column))

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the steady state that is identified in every denoised pass."""
        denoise = self._denoise(values)
        positions: list[int] = []
        passes: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        removed = []
        for batch in self._batches:
            clean = denoise_batch(batch, denoise)
            window = slice(batch.begin, None)
            first = batch.entry if denoise.surround == 'continuation' else batch.begin
            positions += batch.positions
            passes += zip(clean[:, first:], batch.share[:, first:], strict=True)
            removed.append(np.var(batch.force[:, window] - clean[:, window], axis=1))
        noise = self.base.identifier.iswd_eksi.noise
        found = identify_passes(passes, np.concatenate(removed), noise, values['rise_noise'])
        result = np.empty(len(passes))
        # The identifier refuses an unstable platform, so parameters that make one are no good.
        result[positions] = np.where(is_stable(found.a1, found.a2), found.gain, np.nan)
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the table of bands and the platform for denoise, the rise for the identifier."""
        denoise = self._denoise(values)
        return {
            **{f'denoise.{name}': getattr(denoise, name) for name in (*_BANDS, *_PLATFORM)},
            'identifier.iswd_eksi.rise_noise': (values['rise_noise'],),
        }

    def _denoise(self, values: Mapping[str, float]) -> DenoiseParameters:
        """Return the parameters of denoise for the one speed."""
        known = self.base.denoise
        changes: dict[str, Any] = {'speeds': (self.group.speed,)}
        for name in _BANDS:
            at_speed = np.interp(self.group.speed, known.speeds, getattr(known, name))
            changes[name] = (float(at_speed),)
        changes.update({name: (values[name],) for name in (*_BANDS, *_PLATFORM) if name in values})
        return replace(known, **changes)
