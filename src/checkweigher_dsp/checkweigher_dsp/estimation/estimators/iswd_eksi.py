# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ISWD-EKSI estimator: extended Kalman identification of the platform from the denoised signal.

ISWD-EKSI stands for improved stationary wavelet denoising and extended Kalman system
identification. The stage `Denoiser` denoises the signal.
"""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, ClassVar

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_core.records import WeighWindow
from checkweigher_dsp.denoising.window_batch import denoised_pass
from checkweigher_dsp.estimation.estimators.base import (
    Axis,
    Estimator,
    EstimatorParameters,
    LoadEstimate,
    PlotStyle,
    raw_samples,
)
from checkweigher_dsp.estimation.estimators.untrained import doubt
from checkweigher_dsp.signal import Array
from checkweigher_dsp.signal.extended_kalman import Identification, Noise, identify


@dataclass(frozen=True)
class IswdEksiParameters(EstimatorParameters):
    """Parameters of ISWD-EKSI: the variances of the Kalman filter, and the use of `doubt`."""

    node: ClassVar[str] = 'identifier.iswd_eksi'

    measurement_noise: float = parameter(
        0.25,
        'measurement noise R of the Kalman filter, as a multiple of the variance that denoising '
        'removed',
        minimum=1e-9,
        maximum=1e9,
    )
    process_noise: float = parameter(
        0.01, 'process noise Q of the Kalman filter, as a multiple of R', minimum=0, maximum=1e9
    )
    initial_variance: float = parameter(
        1.0,
        'initial variance P0 of x and b1, for a signal that is normalised to 1',
        minimum=1e-9,
        maximum=1e9,
    )
    coefficient_variance: float = parameter(
        1e-6, 'initial variance P0 of a1 and a2', minimum=0, maximum=1e9
    )
    rise_noise: tuple[float, ...] = parameter(
        (10.0,),
        'factor of R from t1 to t2, while the load rises; with 1e9, samples before t2 have '
        'practically no effect',
        minimum=1,
        maximum=1e9,
    )
    doubt: bool = parameter(
        True,
        'whether the untrained estimator averages its result with the level of the window, which '
        'gets more weight the worse the rise of the load fits the assumed platform',
    )

    @property
    def noise(self) -> Noise:
        """Variances of the Kalman filter; R is a multiple of the variance removed by denoising."""
        return Noise(
            self.measurement_noise,
            self.process_noise,
            self.coefficient_variance,
            self.initial_variance,
        )


class IswdEksi(Estimator):
    """Extended Kalman identification of the platform from the denoised signal.

    References
    ----------
    Long et al. (see docs/method.md), section 3 with the errata.

    Examples
    --------
    >>> print(round(IswdEksi(IswdEksiParameters()).estimate(window).mass, 9))
    0.2
    """

    parameters = IswdEksiParameters()
    needs_denoised = True
    look = PlotStyle('ISWD-EKSI', 'o', '#d55e00', '#ff8a3d')
    # All axes but the last one are parameters of the denoiser. The tuner may add gamma5 and the
    # thresholds. The other parameters keep their values; docs/method.md shows their effects.
    axes = (
        Axis('gamma6', 0.0, 1.2, 0.1),
        Axis('gamma7', 0.0, 1.2, 0.5),
        Axis('natural_frequency', 15.0, 120.0, 38.0, logarithmic=True),
        Axis('damping_ratio', 0.01, 0.5, 0.06, logarithmic=True),
        Axis('rise_noise', 1.0, 100.0, 3.0, logarithmic=True),
    )

    def estimate(self, window: WeighWindow) -> LoadEstimate:
        """Return the steady state of the identified platform as the load.

        Without training, `doubt` averages the load with the level of the window, unless the
        parameter ``doubt`` is False.
        """
        return self.estimate_all([window])[0]

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[LoadEstimate]:
        """Return the load in each window. One call of `identify_passes` processes all windows."""
        passes = [denoised_pass(window) for window in windows]
        removed = [
            np.var(raw_samples(window) - window.denoised[window.window_begin : window.window_end])
            for window in windows
        ]
        known = self.parameters
        rises = [known.at('rise_noise', window.belt_speed) for window in windows]
        found = identify_passes(passes, np.array(removed), known.noise, np.array(rises))
        columns = (found.gain, found.variance, found.a1, found.a2, found.b1)
        loads = list(map(LoadEstimate, *(column.tolist() for column in columns)))
        if known.calibrated or not known.doubt:
            return loads
        return [doubt(*each) for each in zip(windows, loads, strict=True)]


def identify_passes(
    passes: Sequence[tuple[Array, Array]], removed_variance: Array, noise: Noise, rise: Any
) -> Identification:
    """Identify the platform from denoised passes.

    Each signal is divided by its mean under the full load, and the removed variance by the square
    of this mean. So the variances of the Kalman filter have no unit.

    Parameters
    ----------
    passes : sequence of tuples of two ndarrays, (n_i,) float64
        For each pass, the denoised signal in kg up to t3, and the fraction of the product on the
        belt at each sample, which increases to 1 at t2.
    removed_variance : ndarray, (passes,) float64
        Variance in kg^2 that denoising removed between t2 and t3.
    noise : Noise
        Variances of the Kalman filter, with R as a multiple of the removed variance.
    rise : float or ndarray, (passes,)
        Factor by which R is multiplied while the load rises, at least 1. A factor above 1 allows
        for products that do not enter at an exactly constant speed.

    Returns
    -------
    Identification
        Result with ``gain`` and ``b1`` in kg and ``variance`` in kg^2. It is NaN for a pass whose
        mean under the full load is 0 or not finite.

    Examples
    --------
    >>> share = np.minimum(np.arange(1.0, 33.0) / 8, 1.0)
    >>> noise = Noise(measurement=0.25, process=0.01, coefficients=1e-6)
    >>> found = identify_passes([(0.2 * share, share)], np.array([1e-8]), noise, rise=10.0)
    >>> print(found.gain.round(6))
    [0.2]
    """
    counts = np.array([len(denoised) for denoised, _ in passes], int)
    rises = [int(np.count_nonzero(share < 1.0)) for _, share in passes]
    samples = np.zeros((len(passes), counts.max(initial=0)))
    inputs = np.empty((len(passes), max(rises, default=0)))
    scales = np.empty(len(passes))
    with np.errstate(all='ignore'):
        for number, ((denoised, share), begin) in enumerate(zip(passes, rises, strict=True)):
            scale = float(np.add.reduce(denoised[begin:]) / (len(denoised) - begin))
            scales[number] = scale if math.isfinite(scale) and scale != 0 else math.nan
            np.divide(denoised, scales[number], out=samples[number, : len(denoised)])
            inputs[number, :begin], inputs[number, begin:] = share[:begin], 1.0
        variance = removed_variance / scales / scales
        found = identify(samples, variance, noise, inputs=inputs, counts=counts, rise=rise)
        return found.in_unit(scales)
