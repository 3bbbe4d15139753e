# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Temporary copies of bags from object stores and other file systems of fsspec."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from pathlib import Path, PurePosixPath
from typing import Any

from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.scratch import scratch_folder


def is_url(place: str) -> bool:
    """Return whether a place is a URL and not a local path."""
    return '://' in place


def holds_bag(names: Iterable[str]) -> bool:
    """Return whether a folder is a bag. `names` are the names of the files in the folder.

    A bag contains ``metadata.yaml`` or an ``.mcap`` file.
    """
    return any(name == 'metadata.yaml' or name.endswith('.mcap') for name in names)


@contextmanager
def local_bag(bag: str) -> Iterator[Path]:
    """Yield the path of a local bag, or the path of a temporary copy if `bag` is a URL.

    The copy is removed when the context ends. If a `BagError` is raised within the context, the
    path of the copy in its message is replaced by the URL.

    Raises `BagError` if the bag cannot be copied.
    """
    if not is_url(bag):
        yield Path(bag)
        return
    with scratch_folder() as folder:
        copy = folder / PurePosixPath(bag.rstrip('/')).name
        with store_errors(bag) as store_of:
            _copy(*store_of(bag), copy)
        try:
            yield copy
        except BagError as error:
            raise type(error)(str(error).replace(str(copy), bag)) from None


@contextmanager
def store_errors(url: str) -> Iterator[Callable[[str], tuple[Any, str]]]:
    """Convert exceptions of the file system of a URL to `BagError`.

    Yields the function ``fsspec.core.url_to_fs``, which returns the file system of a URL and the
    path within that file system.
    """
    from fsspec.core import url_to_fs  # imported late, because the import is slow

    try:
        yield url_to_fs
    except BagError:
        raise
    except ImportError as error:
        raise BagError(f'{url}: {" ".join(str(error).split())}') from None
    # Convert all exceptions, because the fsspec file systems have no common exception class.
    except Exception as error:
        text = ' '.join(str(error).split()) or type(error).__name__
        if isinstance(error, FileNotFoundError):
            # The HTTP file system raises FileNotFoundError for every failure, so the cause of the
            # exception decides whether the file is really missing.
            cause = ' '.join(str(error.__cause__ or '').split())
            missing = not cause or getattr(error.__cause__, 'status', None) == HTTPStatus.NOT_FOUND
            text = 'there is no such file or folder' if missing else cause
        raise BagError(f'{url}: cannot be read: {text}') from None


def _copy(store: Any, path: str, copy: Path) -> None:
    """Copy a file, or the files of a folder, from a file system of fsspec to the path `copy`.

    Subfolders are not copied. Raises `FileNotFoundError` if the folder has no files, and `BagError`
    if the folder is not a bag. Exceptions of the file system are not converted.
    """
    if path.endswith(('.mcap', '.db3')):
        store.get_file(path, str(copy))
        return
    entries = store.ls(path.rstrip('/'), detail=True)
    names = [str(each['name']) for each in entries if each['type'] == 'file']
    files = {PurePosixPath(name).name: name for name in names}
    if not files:
        raise FileNotFoundError(path)
    if not holds_bag(files):
        raise BagError(f'{path}: no bag in this folder')
    copy.mkdir()
    for name, file in files.items():
        store.get_file(file, str(copy / name))
