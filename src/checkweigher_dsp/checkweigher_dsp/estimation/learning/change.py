# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Detection of lasting changes of a machine from the residuals of the items."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from checkweigher_core.parameters import parameter
from checkweigher_core.settings_files import Settings
from checkweigher_dsp.estimation.estimators.learned import PARTS
from checkweigher_dsp.estimation.learning.regression import Fit, usual_power
from checkweigher_dsp.signal import Array

RECENT = 20  # number of recent items in which a change is searched for
_ALIKE = 1.25  # largest factor by which a compared load may be outside the range of learned loads.
# Smallest median residual of a part that indicates a change, in learned standard deviations of the
# part.
_MOVED = 1.5
# Smallest ratio of the power of a spectral line to its learned power that indicates a change.
_GROWN = 6.0
# A change is a vibration only if the standard deviation of the mean of several residuals is at most
# this fraction of the standard deviation of single residuals.
_SAME_PHASE = 0.6
# Smallest increase of the power of a spectral line that indicates a change, as a fraction of the
# total learned power.
_STRONG = 0.1


@dataclass(frozen=True)
class Change(Settings):
    """Lasting change of the machine at a place of the pass or at a frequency.

    If the load has changed at a place of the pass, `frequency` is NaN. `place` is relative, 0 at t1
    and 1 at t3. The median residual at `place` differs from 0 by `factor` learned standard
    deviations. If a vibration has grown, `place` is NaN, and the power at `frequency` in Hz is
    `factor` times the learned power.
    """

    item_id: int = parameter(text='number of the item with which the change was noticed')
    place: float = parameter(math.nan, 'relative place in the pass, 0 at t1 and 1 at t3')
    frequency: float = parameter(math.nan, 'frequency of a vibration', unit='Hz')
    factor: float = parameter(0.0, 'difference in standard deviations, or factor of the power')

    def __str__(self) -> str:
        if np.isnan(self.frequency):
            return (
                f'the load differs by {self.factor:.1f} standard deviations at '
                f'{100 * self.place:.0f} % of the way from t1 to t3'
            )
        return f'the vibration at {self.frequency:.1f} Hz has {self.factor:.1f} times its power'


def is_comparable(known: Fit, load: float) -> bool:
    """Return whether a load in kg is close to the loads from which `known` was learned."""
    smallest, largest = known.loads
    return smallest / _ALIKE <= load <= largest * _ALIKE


def find_change(
    known: Fit, residuals: Sequence[Array], duration: float, item_id: int
) -> Change | None:
    """Return the change of the machine that the residuals of the last items show.

    Returns None if the residuals show no change, or if there are fewer than `RECENT` residuals. The
    residual of an item is (k,) in kg; see `Fit.residual`. `duration` is the duration of a part of
    the pass in s, and `item_id` the number of the last item.
    """
    if len(residuals) < RECENT:
        return None
    # The medians are used, so that single items do not indicate a change.
    halves = np.array_split(np.array(residuals), 2)
    before, after = (np.median(half, axis=0) / known.noise for half in halves)
    moved = np.where(before * after > 0, np.minimum(abs(before), abs(after)), 0.0)
    power = np.minimum(*(usual_power(half) for half in halves))
    matters = power - known.spectrum > _STRONG * known.spectrum.sum()
    grown = np.where(matters, power / known.spectrum, 0.0)
    place, line = int(np.argmax(moved)), int(np.argmax(grown))
    if moved[place] < _MOVED and grown[line] < _GROWN:
        return None
    # A vibration has a random phase in each item, so it is small in the mean of the items. A change
    # that is large in the mean of the items is therefore a change of the load at a place of the
    # pass.
    last = halves[-1]
    if grown[line] < _GROWN or np.mean(last, axis=0).std() > _SAME_PHASE * last.std():
        place = int(np.argmax(abs(after)))
        share = (place - known.lead + 0.5) / PARTS
        return Change(item_id, share, float('nan'), float(abs(after[place])))
    frequency = _peak(power - known.spectrum, line) / (len(known.weights) * duration)
    return Change(item_id, float('nan'), frequency, float(grown[line]))


def strongest_frequency(known: Fit, duration: float) -> float:
    """Return the frequency in Hz, above 0, at which the residuals have the largest learned power.

    `duration` is the duration of a part of the pass in s.
    """
    line = 1 + int(np.argmax(known.spectrum[1:]))
    return _peak(known.spectrum, line) / (len(known.weights) * duration)


def _peak(power: Array, line: int) -> float:
    """Return the position of the peak of a spectrum near a line, as an index with a fraction.

    The position is the mean of the indices of the line and its neighbours, weighted by their power.
    Negative power is ignored.
    """
    around = np.arange(max(line - 1, 0), min(line + 2, len(power)))
    share = np.maximum(power[around], 0.0)
    return float(around @ share / share.sum())
