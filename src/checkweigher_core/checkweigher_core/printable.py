# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Printable texts for logs, messages and terminals."""

# Default of the largest number of characters of a text, before escape sequences are inserted.
_LONGEST = 500


def one_line(text: object, longest: int = _LONGEST) -> str:
    """Return a text as one printable line.

    If the text has more than `longest` characters, its middle is replaced by an ellipsis. Each run
    of whitespace, such as a line break, is replaced by one space. All other characters that are not
    printable are replaced by escape sequences, because a terminal would execute control characters.
    """
    line = str(text)
    if len(line) > longest:
        line = f'{line[: 2 * longest // 3]} ... {line[-longest // 4 :]}'
    return ''.join(
        each if each.isprintable() else each.encode('unicode_escape').decode('ascii')
        for each in ' '.join(line.split())
    )


def counted(count: int, name: str) -> str:
    """Return a number with a noun in the singular or plural.

    >>> counted(1, 'gap'), counted(0, 'gap')
    ('1 gap', '0 gaps')
    """
    return f'{count} {name}{"" if count == 1 else "s"}'
