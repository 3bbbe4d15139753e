# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Estimation of the time lag between photo-eyes and samples from training passes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.signal.rise_lag import lag_of
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed

_FEWEST = 3  # smallest number of passes of one speed with a known lag
_DIGITS = 7  # number of decimal places of the parameters


def unchecked(segmenter: SegmenterParameters) -> SegmenterParameters:
    """Return parameters that switch off the comparison of photo-eyes and rise of the load.

    A segmenter with these parameters cuts the windows by the photo-eyes alone, as tuning requires.
    """
    return replace(segmenter, rise_lag_tolerance=0.0)


def stated_lag(passes: Sequence[KnownPass], segmenter: SegmenterParameters) -> SegmenterParameters:
    """Return parameters of the segmenter with the lag of the training passes.

    The learned parameters of an estimator are valid for this lag only. The windows of `passes` must
    have been cut by the photo-eyes alone. The lag is modelled as a delay plus a distance divided by
    the belt speed. This model is fitted by least squares to the median lag at each speed, and its
    largest residual is added to the tolerance. Passes with faults or with an unknown lag are
    ignored. Speeds at which fewer than three passes remain are also ignored. With passes of one
    speed, only the delay is fitted, and the distance is 0. `segmenter` is returned unchanged if its
    tolerance is 0, or if all speeds are ignored.
    """
    rows = []
    for group in group_by_speed(passes):
        lags = [lag for each in group.passes if (lag := lag_of(each.window)).is_known]
        if len(lags) >= _FEWEST:
            rows.append((1.0, 1 / group.speed, float(np.median([lag.lag for lag in lags]))))
    if not rows or not segmenter.rise_lag_tolerance:
        return segmenter
    table = np.array(rows)
    terms = table[:, : min(len(rows), 2)]
    found = np.linalg.lstsq(terms, table[:, 2], rcond=None)[0]
    unexplained = float(np.max(np.abs(terms @ found - table[:, 2])))
    delay, distance = (round(float(value), _DIGITS) for value in (*found, 0.0)[:2])
    return replace(
        segmenter,
        rise_lag=delay,
        rise_lag_distance=distance,
        rise_lag_known=True,
        rise_lag_tolerance=round(segmenter.rise_lag_tolerance + unexplained, _DIGITS),
    )
