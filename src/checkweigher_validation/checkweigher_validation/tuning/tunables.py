"""What the search turns at each estimator, and the masses that follow for all passes at once."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.estimation.estimators.aeksi import identify_adaptive_by_ekf
from checkweigher_dsp.estimation.estimators.aid import AdaptiveSettings, identify_adaptive
from checkweigher_dsp.estimation.estimators.base import raw_samples
from checkweigher_dsp.estimation.estimators.fir_model import fir_estimate, fit_fir
from checkweigher_dsp.estimation.estimators.tvlpf import decay_of, time_varying_lowpass
from checkweigher_dsp.signal.averages import hann_mean
from checkweigher_dsp.signal.extended_kalman import Noise
from checkweigher_validation.tuning.calibration import folds
from checkweigher_validation.tuning.gauss_markov import TunedGaussMarkov
from checkweigher_validation.tuning.iswd_eksi import TunedIswdEksi
from checkweigher_validation.tuning.search import Axis
from checkweigher_validation.tuning.tunable import Tunable

_FOLDS = 5


class TunedMean(Tunable):
    """The mean: nothing to turn."""

    name = 'mean'

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the mean of every window."""
        return self.of_windows(lambda samples: np.mean(samples, axis=-1))


class TunedHann(Tunable):
    """The Hann-weighted mean: nothing to turn."""

    name = 'hann'

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the Hann-weighted mean of every window."""
        return self.of_windows(hann_mean)


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
        return self.of_windows(
            lambda samples: time_varying_lowpass(
                samples, round(values['sections']), values['initial_cutoff'],
                values['final_cutoff'], decay_of(values['half_life'], samples.shape[1]),
                self.sample_rate,
            )
        )  # fmt: skip


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
            lambda samples: identify_adaptive(samples, settings, self.sample_rate).mass
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
        return self.of_windows(
            lambda samples: (
                identify_adaptive_by_ekf(samples, settings, noise, self.sample_rate).mass
            )
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
                result[rows[out]] = fir_estimate(samples[out], curve)
        return result

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the curve that all passes teach."""
        curve = self._fit(np.arange(len(self.group.passes)), values['ridge'])
        return {'identifier.fir_model.weights': tuple(float(f'{value:.7g}') for value in curve)}

    def _fit(self, chosen: NDArray[np.intp], ridge: float) -> NDArray[np.float64]:
        windows = [raw_samples(self.group.passes[number].window) for number in chosen]
        knots = self.base.identifier.fir_model.knots
        return fit_fir(windows, self.group.masses[chosen], knots, ridge)


TUNABLES: dict[str, type[Tunable]] = {
    tunable.name: tunable
    for tunable in (
        TunedMean,
        TunedHann,
        TunedTvlpf,
        TunedAid,
        TunedAeksi,
        TunedIswdEksi,
        TunedFirModel,
        TunedGaussMarkov,
    )
}
