# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Search for bags in local folders and object stores."""

from collections.abc import Iterable, Iterator, Mapping
import os
from pathlib import Path, PurePosixPath
from typing import Any

from checkweigher_recording.archive.copying import holds_bag, is_url, store_errors
from checkweigher_recording.bags.definitions import BagError

_SUFFIXES = ('.mcap', '.db3')


def find_bags(places: Iterable[str]) -> dict[str, str]:
    """Return the bags in the given places, as a mapping from each bag to its place.

    A place is a path or a URL of fsspec. If a place is a file, it is returned as a bag, as is a
    path that does not exist. If a place is a folder, the folder and its subfolders are searched for
    folders with a ``.mcap`` file or ``metadata.yaml``, which are returned as bags. Subfolders
    within a bag, and subfolders whose names begin with a dot, are not searched. The bags are in the
    order of `places`, and in alphabetical order within a place. A bag that can be found by several
    paths is returned once. If a place has no bag or cannot be listed, the place itself is returned
    as a bag, so that the caller gets the error when it reads that bag.

    Raises `BagError` if there are places, but none of them has a bag.
    """
    found: dict[str, str] = {}
    seen: set[str] = set()
    without: list[BagError] = []
    places = list(places)
    for place in places:
        try:
            bags = _bags_in(place)
        except BagError as error:
            without.append(error)
            bags = [place]
        for bag in bags:
            if (same := _spelled_out(bag)) not in seen:
                seen.add(same)
                found[bag] = place
    if without and len(without) == len(places):
        raise without[0]
    return found


def result_names(found: Mapping[str, str]) -> dict[str, str]:
    """Return a unique relative path for the results of each bag that `find_bags` has found.

    The path consists of the last folder of the place and the path of the bag within the place. If
    two bags would have the same path, all paths begin with one or more parent folders of the place.
    With a single place, the path of a bag does not change when other bags are added.

    Raises `BagError` if the paths cannot be made unique, because two places differ only in their
    spelling.
    """
    parts = {bag: _parts(bag) for bag in found}
    above = {bag: max(len(_parts(place)) - 1, 0) for bag, place in found.items()}
    names: dict[str, str] = {}
    for more in range(max(above.values(), default=0) + 1):
        names = {bag: '/'.join(parts[bag][max(above[bag] - more, 0) :]) for bag in found}
        if len(set(names.values())) == len(names):
            return names
    raise BagError('places of bags differ only in spelling; weigh the bags one by one')


def _spelled_out(bag: str) -> str:
    """Return the absolute path of a local bag without symbolic links, or the URL of a remote bag.

    A URL that begins with ``file://`` is a local bag.
    """
    path = bag.removeprefix('file://')
    return path if is_url(path) else os.path.realpath(path)


def _parts(bag: str) -> tuple[str, ...]:
    """Return the parts of the absolute path of a bag. The first part of a URL is its protocol."""
    if is_url(bag):
        protocol, _, rest = bag.partition('://')
        parts = (part for part in rest.split('/') if part not in ('', '.'))
        return (protocol, *('_' if part == '..' else part for part in parts))
    return tuple(part for part in os.path.abspath(bag).split('/') if part)


def _bags_in(place: str) -> list[str]:
    """Return the bags in a place.

    Raises `BagError` if the place has no bag or cannot be listed.
    """
    try:
        bags = list(_stored_bags(place) if is_url(place) else _local_bags(Path(place)))
    except OSError as error:
        raise BagError(f'{place}: cannot be read: {error.strerror or error}') from None
    if not bags:
        raise BagError(f'{place}: no bag in this folder')
    return bags


def _local_bags(place: Path) -> Iterator[str]:
    if not place.is_dir() or holds_bag(os.listdir(place)):
        yield str(place)
        return
    for folder, names, files in os.walk(place):
        if holds_bag(files):
            yield folder
            names.clear()
            continue
        names[:] = sorted(name for name in names if not name.startswith('.'))


def _stored_bags(url: str) -> Iterator[str]:
    with store_errors(url) as store_of:
        store, path = store_of(url)
        if path.endswith(_SUFFIXES):
            yield url
            return
        yield from map(store.unstrip_protocol, _listed(store, path.rstrip('/')))


def _listed(store: Any, path: str) -> Iterator[str]:
    entries = store.ls(path, detail=True)
    if holds_bag(PurePosixPath(entry['name']).name for entry in entries):
        yield path
        return
    for entry in sorted(entries, key=lambda entry: str(entry['name'])):
        name = str(entry['name']).rstrip('/')
        below = name.removeprefix(f'{path}/')
        if entry['type'] == 'directory' and below != name and below[:1] != '.':
            yield from _listed(store, name)
