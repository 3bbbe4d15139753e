# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tuning of the estimator ISWD-EKSI together with the denoising that precedes it."""

from collections.abc import Mapping
from dataclasses import replace
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.estimators.base import Axis
from checkweigher_dsp.signal.extended_kalman import is_stable
from checkweigher_validation.tuning.tunables import Tunable

_BANDS = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
_THRESHOLD_FACTOR = 1000.0  # largest ratio of a threshold to its start value in the search
_PLATFORM = ('natural_frequency', 'damping_ratio')


class TunedIswdEksi(Tunable):
    """Tuning of ISWD-EKSI, including the shrinkage table and the platform model of the denoiser.

    The factor of band 5 and the thresholds are searched only if their values in `base` are
    positive, as in Table 1 of the paper (Long et al.). The covariances R, Q and P0 of the
    Kalman filter are not tuned.
    """

    def searched(self) -> tuple[Axis, ...]:
        """Return the axes of the search, one for each searched parameter.

        The axes of `gamma5` and of the thresholds are included only for parameters whose value in
        `base` is positive at this speed.
        """
        found = list(self.estimator.axes)
        for name in ('gamma5', 'lambda5', 'lambda6', 'lambda7'):
            start = self.start(Axis(name, 0.0, 0.0, 0.0))
            if start > 0 and name == 'gamma5':
                found.append(Axis(name, 0.0, 1.2, start))
            elif start > 0:
                low, high = start / _THRESHOLD_FACTOR, start * _THRESHOLD_FACTOR
                found.append(Axis(name, low, high, start, logarithmic=True))
        return tuple(found)

    def start(self, axis: Axis) -> float:
        """Return the start value of an axis, which is the value in `base` at this speed."""
        known = self.base.denoise
        if not hasattr(known, axis.name):
            return super().start(axis)
        column = getattr(known, axis.name)
        return float(np.interp(self.group.speed, known.speeds[: len(column)], column))

    def estimates(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the estimated load of each pass, (n,) in kg.

        The load is NaN if the platform model that is identified from the pass is unstable.
        """
        passes = [each.window for each in self.group.passes]
        windows = Denoiser(self._denoise(values)).denoise_all(passes)
        own = {'rise_noise': (values['rise_noise'],), 'doubt': False}
        loads = self.estimator(self.known.for_speed(self.group.speed, own)).estimate_all(windows)
        # Return NaN for an unstable platform, because the identifier does not accept it either.
        return np.array([each.mass if is_stable(each.a1, each.a2) else math.nan for each in loads])

    def lists(self, values: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
        """Return the shrinkage and platform parameters of the denoiser, and the rise noise.

        A key has the form ``node.name``.
        """
        denoise = self._denoise(values)
        return {
            **{f'denoise.{name}': getattr(denoise, name) for name in (*_BANDS, *_PLATFORM)},
            'identifier.iswd_eksi.rise_noise': (values['rise_noise'],),
        }

    def _denoise(self, values: Mapping[str, float]) -> DenoiseParameters:
        known = self.base.denoise
        changes: dict[str, Any] = {'speeds': (self.group.speed,)}
        for name in _BANDS:
            at_speed = np.interp(self.group.speed, known.speeds, getattr(known, name))
            changes[name] = (float(values.get(name, at_speed)),)
        changes |= {name: (values[name],) for name in _PLATFORM if name in values}
        return replace(known, **changes)
