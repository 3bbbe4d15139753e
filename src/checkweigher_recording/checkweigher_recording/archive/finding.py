# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bags in folders, on this machine or in an object store."""

from collections.abc import Iterable, Iterator
from itertools import takewhile
import os
from pathlib import Path, PurePosixPath
from typing import Any

from checkweigher_recording.archive.copying import is_url, store_errors
from checkweigher_recording.bags.definitions import BagError

_SUFFIXES = ('.mcap', '.db3')
_DEEPEST = 20  # folders in each other


def find_bags(places: Iterable[str]) -> list[str]:
    """Return bags and the bags in folders, each once, in the order of their places and names.

    A place is a path or a URL of fsspec. A bag is a file ``.mcap`` or ``.db3``, or a folder with
    one, or with ``metadata.yaml``; what is no bag is returned as it is if it is no folder, so that
    reading it says what is wrong. Folders whose names begin with a point are passed over.

    Raises
    ------
    BagError
        If there is no bag in a folder, or a place of an object store cannot be listed.
    """
    found: dict[str, None] = {}
    for place in places:
        bags = list(_stored_bags(place) if is_url(place) else _local_bags(Path(place)))
        if not bags:
            raise BagError(f'{place}: no bag in this folder')
        found.update(dict.fromkeys(bags))
    return list(found)


def result_names(bags: Iterable[str]) -> dict[str, str]:
    """Return a name for the results of each bag: its place below the folder that all share.

    The parts of a name are separated by slashes; no two are the same.
    """
    parts = {bag: _parts(bag) for bag in bags}
    alike = takewhile(
        lambda names: len(set(names)) == 1,
        zip(*(each[:-1] for each in parts.values()), strict=False),
    )
    shared = sum(1 for _ in alike)
    return {bag: '/'.join(each[shared:]) for bag, each in parts.items()}


def _parts(bag: str) -> tuple[str, ...]:
    """Return the folders and the name of a bag; those of a URL begin with its protocol."""
    if is_url(bag):
        protocol, _, rest = bag.partition('://')
        parts = (part for part in rest.split('/') if part not in ('', '.'))
        return (protocol, *('_' if part == '..' else part for part in parts))
    return tuple(part for part in os.path.abspath(bag).split('/') if part)


def _local_bags(place: Path) -> Iterator[str]:
    if not place.is_dir() or _is_bag(os.listdir(place)):
        yield str(place)
        return
    for folder, names, files in os.walk(place):
        if _is_bag(files):
            yield folder
            names.clear()
            continue
        names[:] = sorted(name for name in names if not name.startswith('.'))


def _stored_bags(url: str) -> Iterator[str]:
    """Yield the bags below a URL."""
    with store_errors(url) as store_of:
        store, path = store_of(url)
        if path.endswith(_SUFFIXES):
            yield url
            return
        yield from map(store.unstrip_protocol, _listed(store, path.rstrip('/'), _DEEPEST))


def _listed(store: Any, path: str, deepest: int) -> Iterator[str]:
    entries = store.ls(path, detail=True)
    names = {PurePosixPath(entry['name']).name for entry in entries}
    if _is_bag(names):
        yield path
        return
    for entry in sorted(entries, key=lambda entry: str(entry['name'])):
        name = str(entry['name']).rstrip('/')
        below = name.removeprefix(f'{path}/')
        if entry['type'] == 'directory' and deepest and below != name and below[:1] != '.':
            yield from _listed(store, name, deepest - 1)


def _is_bag(names: Iterable[str]) -> bool:
    return any(name == 'metadata.yaml' or name.endswith('.mcap') for name in names)
