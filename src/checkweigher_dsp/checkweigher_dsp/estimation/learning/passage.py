# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parts of the pass of an item of unknown mass."""

from dataclasses import dataclass
import math

import numpy as np

from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.records import WeighWindow
from checkweigher_core.settings_files import Settings
from checkweigher_dsp.denoising.window_batch import rise_time, transit
from checkweigher_dsp.estimation.estimators.base import LoadEstimate
from checkweigher_dsp.estimation.estimators.learned import (
    PARTS,
    Layout,
    pass_features,
    rise_parts,
    seconds_alone,
)
from checkweigher_dsp.estimation.estimators.untrained import SETTLE_TIME
from checkweigher_dsp.signal import Array

MOST_LEAD = 48  # largest number of parts before t1


@dataclass(frozen=True)
class PassParts(Settings):
    """Parts of a pass, with the load that the selected estimator found.

    `parts`, (lead + PARTS,) in kg, are computed by `pass_features`. The first `lead` parts are
    before t1. The last `quiet` parts before t1 contain no ring-down of the previous item. Raises
    `SettingsError` if there are fewer than `PARTS` parts, or if `quiet` exceeds `lead`.
    """

    parts: Array = parameter(text='parts of the pass', unit='kg')
    quiet: int = parameter(text='parts without ring-down', minimum=0)
    duration: float = parameter(text='duration of a part', unit='s', minimum=0)
    load: float = parameter(text='load by the estimator', unit='kg', minimum=0)
    variance: float = parameter(
        text='variance of the load by the estimator, or 0 if it is unknown', unit='kg^2', minimum=0
    )
    zero_variance: float = parameter(text='variance of the zero', unit='kg^2', minimum=0)

    def __post_init__(self) -> None:
        if len(self.parts) < PARTS:
            raise SettingsError(
                f'{len(self.parts)} parts, but at least {PARTS} are needed', 'parts'
            )
        if self.quiet > self.lead:
            raise SettingsError(f'{self.quiet} exceeds the {self.lead} parts before t1', 'quiet')

    @property
    def lead(self) -> int:
        """Number of parts before t1."""
        return len(self.parts) - PARTS


def rise_parts_of(window: WeighWindow) -> int:
    """Return the number of parts of a pass from t1 to t2.

    The result is 0 if t1, t2 or t3 is unknown, or if the times are not in the order t1 < t2 < t3.
    """
    whole = transit(window)
    share = rise_time(window) / whole if whole > 0 else 0.0
    return rise_parts(share) if 0 < share < 1 else 0


def passage_of(window: WeighWindow, load: LoadEstimate, rise: int) -> PassParts | None:
    """Return the parts of the pass in a window, with `rise` parts from t1 to t2.

    Returns None if the previous item was on the belt at t1, if the estimator found no positive
    load, or if the signal does not cover all parts.
    """
    duration, alone = transit(window) / PARTS, seconds_alone(window)
    if not (load.mass > 0 and alone >= 0 and duration > 0):
        return None
    lead = min(int(alone / duration), MOST_LEAD)
    parts = pass_features(window, Layout(lead, rise, PARTS - rise))
    if not np.all(np.isfinite(parts)):
        return None
    quiet = int(max(alone - SETTLE_TIME, 0.0) / duration)
    zero = window.zero_std_dev / window.counts_per_kg
    variance = load.variance if math.isfinite(load.variance) else 0.0
    return PassParts(parts, min(quiet, lead), duration, load.mass, variance, zero * zero)
