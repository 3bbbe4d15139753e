# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Agreement of samples and photo-eyes, as the rise of the load shows it."""

import math

from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_dsp.segmentation.edge_check import EdgeCheck

_MILLI = 1e3
_CHANGED = 1.5e-3  # s; products that ride on differently change the median of some by a third of it
_LARGE = 2e-3  # s
_MANY_UNCHECKED = 0.5  # share of the items
_FEWEST = 10  # items


def edges_finding(check: EdgeCheck) -> Finding:
    """Return the aspect Eyes and samples."""
    lag, change, reference = (_MILLI * value for value in (check.lag, check.change, check.learned))
    values = {
        'lag_beyond_stated_ms': lag,
        'learned_lag_beyond_stated_ms': reference,
        'change_ms': change,
        'items_checked': check.checked,
        'items_unchecked': check.unchecked,
    }
    found = []
    if abs(check.change) > _CHANGED:
        side = 'later' if change > 0 else 'earlier'
        text = f'the load comes on {abs(change):.1f} ms {side} than the eyes say and said before'
        hint = 'check the filter of the amplifier, the clocks, and the place and delay of the eyes'
        found.append(Concern(Level.ERROR, text, hint))
    # Of a lag that is too large to be learned each item is a FAULT.
    too_large = math.isnan(check.learned) and check.checked >= _FEWEST
    if not check.is_stated and abs(check.lag if too_large else check.learned) > _LARGE:
        beyond = lag if too_large else reference
        text = f'samples lag {beyond:.1f} ms more behind the eyes than rise_lag says'
        hint = 'measure it by calibrate --dynamic, or set rise_lag to what the amplifier delays'
        found.append(Concern(Level.ERROR if too_large else Level.WARN, text, hint))
    if check.unchecked > _MANY_UNCHECKED * max(check.checked + check.unchecked, _FEWEST):
        text = 'the rise of most items is not seen, so that nothing confirms the eyes'
        hint = 'leave at least 0.06 s of empty belt before each item'
        found.append(Concern(Level.WARN, text, hint))
    well = 'no item yet' if math.isnan(lag) else f'the load comes on {lag:+.1f} ms from the eyes'
    return conclude('Eyes and samples', well, found, values)
