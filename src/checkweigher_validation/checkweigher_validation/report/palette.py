# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names and colours of estimators: the same ones in every table and figure.

Colours are told apart with any kind of colour vision (after Okabe and Ito), each in a light and a
dark variant; every estimator has a marker of its own as well.
"""

from itertools import cycle

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.estimators.base import Look

_LOOKS = {name: each.look for name, each in ESTIMATORS.items() if each.look}
# One of the others, see CHOSEN.
_LOOKS['chosen'] = Look('Chosen by tune', '<', '#7a5230', '#c79a6f')

# For estimators that have no look of their own.
_OTHERS = (('>', '#5f6b1f', '#b5c45a'), ('p', '#6b4fa0', '#b39ae0'))


def looks_of(estimators: tuple[str, ...]) -> dict[str, Look]:
    """Return the looks of estimators by name; one that is not known here is called as it is."""
    others = cycle(_OTHERS)
    return {
        name: _LOOKS[name] if name in _LOOKS else Look(name, *next(others)) for name in estimators
    }
