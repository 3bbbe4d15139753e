# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts for verdicts, reasons, masses and times."""

import math

from checkweigher_core.records import GRAMS, Verdict, local_time
from checkweigher_core.records.reasons import hint_of

# Decisions also have a sign, because some users cannot distinguish the colours.
_SIGNS = {'ACCEPT': '✓', 'UNDER': '↓', 'OVER': '↑', 'FAULT': '✗'}


def decided(verdict: Verdict) -> str:
    """Return the decision of a verdict with its sign."""
    name = verdict.decision.name
    return f'{_SIGNS[name]} {name}'


def said(verdict: Verdict) -> str:
    """Return the decision and the reasons of a verdict."""
    return f'{decided(verdict)} {", ".join(verdict.reasons)}'.rstrip()


def why(verdict: Verdict) -> str:
    """Return the reasons of a verdict, each with a hint for the user."""
    return '; '.join(f'{reason}: {hint_of(reason)}' for reason in verdict.reasons)


def when(verdict: Verdict) -> str:
    """Return the local time of an item, or a dash if the time is not known."""
    return clock(verdict.time)


def clock(stamp: int | None) -> str:
    """Return the local time of a stamp in ns, or a dash if the stamp is None."""
    if stamp is None:
        return '–'
    return f'{local_time(stamp):%H:%M:%S}'


def grams(mass: float, unit: str = '', digits: int = 3) -> str:
    """Return the text for a mass in kg, in g."""
    return number(GRAMS * mass, digits, unit)


def number(value: float, digits: int, unit: str = '') -> str:
    """Return the text for a number with its unit, or a dash for NaN."""
    return f'{value:.{digits}f}{unit}' if math.isfinite(value) else '–'
