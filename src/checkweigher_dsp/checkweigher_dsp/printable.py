# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts from outside, as one printable line for logs, messages and terminals."""

_LONGEST = 500


def one_line(text: object) -> str:
    """Return a text in one line, cut where it is long; what cannot be printed as its escape."""
    short = str(text)
    if len(short) > _LONGEST:
        short = f'{short[:_LONGEST]}...'
    joined = ' '.join(short.split())
    if joined.isprintable():
        return joined
    return ''.join(
        sign if sign.isprintable() else sign.encode('unicode_escape').decode() for sign in joined
    )
