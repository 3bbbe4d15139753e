# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts for logs, messages and terminals: names of topics, files and products come from others."""

_LONGEST = 500  # characters


def one_line(text: object, longest: int = _LONGEST) -> str:
    """Return a text as one printable line.

    Control characters, which a terminal would obey, are shown as escapes. Of a longer line the
    middle is left out.
    """
    line = str(text)
    if len(line) > longest:
        line = f'{line[: 2 * longest // 3]} ... {line[-longest // 4 :]}'
    return ''.join(
        each if each.isprintable() else _escaped(each) for each in ' '.join(line.split())
    )


def counted(count: int, name: str) -> str:
    """Return how many there are of something: its name is that of one, with an s for more.

    >>> counted(1, 'gap'), counted(0, 'gap')
    ('1 gap', '0 gaps')
    """
    return f'{count} {name}{"" if count == 1 else "s"}'


def _escaped(character: str) -> str:
    return character.encode('unicode_escape').decode('ascii')
