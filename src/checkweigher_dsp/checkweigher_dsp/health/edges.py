# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Agreement of samples and photo-eyes, as the rise of the load shows it."""

import math

from checkweigher_core.health.findings import Concern, Finding, Level, conclude, error_if, warn_if
from checkweigher_dsp.segmentation.edge_check import EdgeCheck

_MILLI = 1e3
# ms; products that ride on differently change the median of a few items by a third of it.
_CHANGED = 1.5
_LARGE = 2.0  # ms
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
    side = 'later' if change > 0 else 'earlier'
    # With a lag that is too large to be learned each item is a FAULT.
    too_large = math.isnan(check.learned) and check.checked >= _FEWEST
    beyond = lag if too_large else reference
    is_large = not check.is_stated and abs(beyond) > _LARGE
    unstated = Concern(
        Level.ERROR if too_large else Level.WARN,
        f'samples lag {beyond:.1f} ms more behind the eyes than rise_lag says',
        'measure it by calibrate --dynamic, or set rise_lag to what the amplifier delays',
    )
    concerns = [
        error_if(
            abs(change) > _CHANGED,
            f'the load comes on {abs(change):.1f} ms {side} than the eyes say and said before',
            'check the filter of the amplifier, the clocks, and the place and delay of the eyes',
        ),
        unstated if is_large else None,
        warn_if(
            check.unchecked > _MANY_UNCHECKED * max(check.checked + check.unchecked, _FEWEST),
            'the rise of most items is not seen, so that nothing confirms the eyes',
            'leave at least 0.06 s of empty belt before each item',
        ),
    ]
    well = 'no item yet' if math.isnan(lag) else f'the load comes on {lag:+.1f} ms from the eyes'
    return conclude('Eyes and samples', well, concerns, values)
