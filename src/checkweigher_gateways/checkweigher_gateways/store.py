# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Items that wait for the broker, stored on disk."""

from collections.abc import Iterator
from pathlib import Path
import sqlite3
import uuid

from checkweigher_core.state_files import make_folder

_SCHEMA = """
CREATE TABLE IF NOT EXISTS items (
    number INTEGER PRIMARY KEY AUTOINCREMENT, key TEXT NOT NULL UNIQUE, lane TEXT NOT NULL,
    body TEXT NOT NULL, sent INTEGER NOT NULL DEFAULT 0);
CREATE INDEX IF NOT EXISTS waiting ON items (number) WHERE sent = 0;
CREATE TABLE IF NOT EXISTS state (name TEXT PRIMARY KEY, value TEXT NOT NULL);
"""
_KNOWN = 20_000  # number of latest items that are kept after they were sent


class Store:
    """Numbered items, which wait until the broker has received them.

    An item whose key is in the file is not added again, because a restarted gateway receives the
    latest items again. If more than `limit` items wait, the oldest waiting item is dropped and
    counted.

    Attributes
    ----------
    identity : str
        Unique ID of the file, which distinguishes its numbers from those of another file.
    waiting : int
        Number of waiting items.
    dropped : int
        Number of items dropped since the start.
    """

    def __init__(self, path: Path, limit: int) -> None:
        make_folder(path.parent)
        self._limit = limit
        self.waiting = self.dropped = 0
        self._database = sqlite3.connect(path)
        self._database.executescript(f'PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; {_SCHEMA}')
        self._database.execute(
            "INSERT OR IGNORE INTO state VALUES ('identity', ?)", [uuid.uuid4().hex]
        )
        self.identity = str(self._value('identity'))
        self._count()
        self.commit()

    def _value(self, name: str) -> str | None:
        found = self._database.execute('SELECT value FROM state WHERE name = ?', [name]).fetchone()
        return None if found is None else str(found[0])

    def next_number(self, name: str, count: int) -> int:
        """Write the next number of a sequence modulo `count` to the disk, and return the number.

        The first number of the sequence `name` is 0.
        """
        number = (int(self._value(name) or -1) + 1) % count
        self._database.execute('INSERT OR REPLACE INTO state VALUES (?, ?)', [name, str(number)])
        self.commit()
        return number

    def add(self, key: str, lane: str, body: str) -> None:
        """Add an item, unless the file contains an item with the same key.

        The item is on the disk after the next `commit`.
        """
        added = self._database.execute(
            'INSERT OR IGNORE INTO items (key, lane, body) VALUES (?, ?, ?)', [key, lane, body]
        ).rowcount
        self.waiting += added
        if self.waiting > self._limit:
            self._database.execute(
                'DELETE FROM items WHERE number = (SELECT min(number) FROM items WHERE sent = 0)'
            )
            self.waiting, self.dropped = self.waiting - 1, self.dropped + 1

    def commit(self) -> None:
        """Write the changes since the previous call to the disk."""
        self._database.commit()

    def _count(self) -> None:
        counted = self._database.execute('SELECT count(*) FROM items WHERE sent = 0')
        self.waiting = int(counted.fetchone()[0])

    def after(self, number: int, count: int) -> Iterator[tuple[int, str, str]]:
        """Yield number, lane and body of up to `count` waiting items after a number, in order."""
        return self._database.execute(
            'SELECT number, lane, body FROM items WHERE sent = 0 AND number > ?'
            ' ORDER BY number LIMIT ?',
            [number, count],
        )

    def have_sent(self, number: int) -> None:
        """Mark the items up to a number as sent, and delete old sent items.

        The latest `_KNOWN` items are kept, because they may be received again.
        """
        self._database.execute('UPDATE items SET sent = 1 WHERE sent = 0 AND number <= ?', [number])
        self._database.execute(
            'DELETE FROM items WHERE sent = 1 AND number <= ?', [number - _KNOWN]
        )
        self._count()

    def close(self) -> None:
        """Close the file."""
        self._database.close()
