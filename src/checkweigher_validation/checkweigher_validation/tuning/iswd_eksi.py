"""Tuning of ISWD-EKSI: the gains of the bands, the platform that it reckons with, the rise."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, denoise_batch
from checkweigher_dsp.denoising.window_batch import batches_of
from checkweigher_dsp.estimation.estimators.iswd_eksi import identify_passes
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.signal.platform_poles import is_stable
from checkweigher_validation.accuracy.passes import SpeedGroup
from checkweigher_validation.tuning.search import Axis
from checkweigher_validation.tuning.tunable import Tunable

_BANDS = ('gamma5', 'gamma6', 'gamma7', 'lambda5', 'lambda6', 'lambda7')
_THRESHOLD_FACTOR = 1000.0  # how far below and above the start a threshold is looked for
_PLATFORM = ('natural_frequency', 'damping_ratio')


class TunedIswdEksi(Tunable):
    """ISWD-EKSI: what of its parameters matters, as docs/method.md has measured it.

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

    def __init__(self, group: SpeedGroup, base: LineParameters) -> None:
        super().__init__(group, base)
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
                factor = _THRESHOLD_FACTOR
                found.append(
                    Axis(name, at_speed / factor, at_speed * factor, at_speed, logarithmic=True)
                )
        return tuple(found)

    def start(self, axis: Axis) -> float:
        """Return what `base` says at this speed, for denoise as well."""
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
