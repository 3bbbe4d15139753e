# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts for verdicts and their reasons."""

from checkweigher_core.records import Verdict
from checkweigher_core.records.reasons import hint_of
from checkweigher_web.languages.language import ENGLISH, Language, Text

# Decisions also have a sign, because some users cannot distinguish the colours.
_SIGNS: dict[str, str] = {
    Text('ACCEPT'): '✓',
    Text('UNDER'): '↓',
    Text('OVER'): '↑',
    Text('FAULT'): '✗',
}


def decided(verdict: Verdict, say: Language = ENGLISH) -> str:
    """Return the decision of a verdict with its sign."""
    name = verdict.decision.name
    return f'{_SIGNS[name]} {say(name)}'


def said(verdict: Verdict, say: Language = ENGLISH) -> str:
    """Return the decision and the reasons of a verdict."""
    return f'{decided(verdict, say)} {", ".join(verdict.reasons)}'.rstrip()


def why(verdict: Verdict, say: Language = ENGLISH) -> str:
    """Return the reasons of a verdict, each with a hint for the user, or '' without reasons."""
    return '; '.join(f'{reason}: {say(hint_of(reason))}' for reason in verdict.reasons)
