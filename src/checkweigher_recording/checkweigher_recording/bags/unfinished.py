"""A recording that was not completed, because its recorder was killed: what is there of it."""

from collections.abc import Collection, Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
import re
from typing import TYPE_CHECKING

from rosbags.interfaces import Connection

if TYPE_CHECKING:
    from checkweigher_recording.bags.fragment import Message

_NUMBER = re.compile(r'_(\d+)$')


class UnfinishedBag:
    """The messages of the files of a recording up to where it broke off.

    Parameters
    ----------
    parts : sequence of Path
        Its files in the order in which they were written; of the last one the end is missing.

    Attributes
    ----------
    connections : list of Connection
        Of all parts, with the numbers of messages that are there.
    damage : str
        Where something is missing with more behind it; only what is before it is there. Empty if
        there is no such place.

    Raises
    ------
    BagError
        If a file is not MCAP.
    OSError
        If a file cannot be read.
    """

    def __init__(self, parts: Sequence[Path]) -> None:
        # Its parsers take as long to import as a whole bag to read.
        from checkweigher_recording.bags.fragment import BagFragment

        self._fragments: list[BagFragment] = []
        self.damage = ''
        for part, following in zip_longest(parts, parts[1:]):
            fragment = BagFragment(part)
            self._fragments.append(fragment)
            if fragment.damage:
                self.damage = f'{part.name}: {fragment.damage}'
            elif following and not fragment.ended:
                self.damage = f'{part.name}: cut off, but there are parts after it'
            elif following and _number(following) > _number(part) + 1:
                self.damage = f'there is no part {_number(part) + 1}'
            if self.damage:
                break
        self.connections = [c for fragment in self._fragments for c in fragment.connections]

    @property
    def message_count(self) -> int:
        """Number of messages that are there."""
        return sum(connection.msgcount for connection in self.connections)

    def messages(self, connections: Collection[Connection]) -> 'Iterator[Message]':
        """Yield connection, log time and data of the messages of some connections."""
        for fragment in self._fragments:
            yield from fragment.messages([c for c in connections if c.owner is fragment])


def unfinished_parts(path: Path) -> list[Path]:
    """Return the files of a folder in their order if it is a recording that was not completed.

    What tells is that it has no ``metadata.yaml``: recorders write that at the end.
    """
    if not path.is_dir() or (path / 'metadata.yaml').exists():
        return []
    return sorted(path.glob('*.mcap'), key=lambda part: (_number(part), part.name))


def _number(part: Path) -> int:
    found = _NUMBER.search(part.stem)
    return int(found[1]) if found else 0
