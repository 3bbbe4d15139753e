# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verdicts, masses, times and reasons in the words of the page."""

from datetime import UTC, datetime
import math

from checkweigher_core.records import GRAMS, NANOSECONDS, Verdict
from checkweigher_core.records.reasons import Reason

# A sign beside the colour, because not everybody sees the colours.
_SIGNS = {'ACCEPT': '✓', 'UNDER': '↓', 'OVER': '↑', 'FAULT': '✗'}


def decided(verdict: Verdict) -> str:
    """Return the decision of a verdict with its sign."""
    name = verdict.decision.name
    return f'{_SIGNS[name]} {name}'


def said(verdict: Verdict) -> str:
    """Return the decision and the reasons of a verdict."""
    return f'{decided(verdict)} {", ".join(verdict.reasons)}'.rstrip()


def why(verdict: Verdict) -> str:
    """Return the reasons of a verdict, each with what to check."""
    return '; '.join(f'{reason}: {hint(reason)}' for reason in verdict.reasons)


def when(verdict: Verdict) -> str:
    """Return the local time at which an item was weighed, or a dash if it is not known."""
    stamp = verdict.t3 or verdict.t1
    if stamp is None:
        return '–'
    return f'{datetime.fromtimestamp(stamp / NANOSECONDS, UTC).astimezone():%H:%M:%S}'


def grams(mass: float, unit: str = '', digits: int = 3) -> str:
    """Return a mass in kg as a number of grams."""
    return number(GRAMS * mass, digits, unit)


def number(value: float, digits: int, unit: str = '') -> str:
    """Return a number with its unit, or a dash for NaN."""
    return f'{value:.{digits}f}{unit}' if math.isfinite(value) else '–'


def hint(reason: str) -> str:
    """Return what to check for a reason."""
    unknown = 'a reason that this version does not know'
    return Reason(reason).hint if reason in Reason.__members__.values() else unknown
