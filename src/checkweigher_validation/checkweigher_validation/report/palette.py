# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Names and colours of estimators: the same ones in every table and figure.

The colours can be distinguished with any kind of colour vision (after Okabe and Ito). Each has a
light and a dark variant, and every estimator also has a marker of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle


@dataclass(frozen=True, slots=True)
class Look:
    """Label of an estimator, its marker in matplotlib, and its colours on light and dark ground."""

    label: str
    marker: str
    light: str
    dark: str


_LOOKS = {
    'mean': Look('Window mean', 's', '#8b929c', '#8b929c'),
    'hann': Look('Hann mean', 'D', '#4d5560', '#c4cad2'),
    'tvlpf': Look('TVLPF', '^', '#c98500', '#e8ac2f'),
    'aid': Look('AID', 'v', '#3aa0dc', '#6cc1f0'),
    'aeksi': Look('AEKSI', 'P', '#009e73', '#2fc79a'),
    'iswd_eksi': Look('ISWD-EKSI', 'o', '#d55e00', '#ff8a3d'),
    'fir_model': Look('FIR model', 'h', '#b4569a', '#db8cc4'),
    'gauss_markov': Look('Gauss-Markov', 'X', '#0058a3', '#7d9bff'),
    'iswd_eksi_paper': Look('ISWD-EKSI, literal', 'd', '#e7a27c', '#b5653a'),
    'learned': Look('Learned', '*', '#a3123a', '#ff6f91'),
    'chosen': Look('Chosen by tune', '<', '#7a5230', '#c79a6f'),  # one of the others, see CHOSEN
}

# Marker and colours of other estimators.
_OTHERS = (('>', '#5f6b1f', '#b5c45a'), ('p', '#6b4fa0', '#b39ae0'))


def looks_of(estimators: Sequence[str]) -> dict[str, Look]:
    """Return the looks of estimators by name; the label of an unknown one is its name."""
    others = cycle(_OTHERS)
    return {
        name: _LOOKS[name] if name in _LOOKS else Look(name, *next(others)) for name in estimators
    }
