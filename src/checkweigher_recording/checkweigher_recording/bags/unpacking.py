# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that were compressed file by file, and their messages, unpacked within bounds."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path, PurePath
from typing import Any

import yaml

from checkweigher_dsp.input_files import open_input
from checkweigher_dsp.yaml_files import read_yaml
from checkweigher_recording.bags.bounds import LARGEST_FILE, LARGEST_RECORD, unpack_zstd
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.scratch import scratch_folder

_MOST = 1 << 30  # bytes on the disk
_SECTION = 'rosbag2_bagfile_information'
_PIECE = 1 << 20  # bytes


def read_metadata(path: Path) -> dict[str, Any]:
    """Return the information of a folder's ``metadata.yaml``, empty if there is none in it.

    Raises
    ------
    BagError
        If it is no YAML, or more than a bag needs.
    OSError
        If it cannot be read.
    """
    try:
        content = read_yaml(path / 'metadata.yaml')
    except ValueError as error:
        raise BagError(
            f'{path / "metadata.yaml"}: damaged: {error}; run "ros2 bag reindex"'
        ) from None
    information = content.get(_SECTION) if isinstance(content, dict) else None
    return information if isinstance(information, dict) else {}


def files_of(path: Path, information: Mapping[str, Any]) -> list[Path]:
    """Return the files that the information of a folder names."""
    names = information.get('relative_file_paths')
    return [path / PurePath(str(name)).name for name in names] if isinstance(names, list) else []


def compression_mode(information: Mapping[str, Any]) -> str:
    """Return what is compressed with zstd: ``file``, ``message`` or nothing."""
    packed = information.get('compression_format') == 'zstd'
    return str(information.get('compression_mode') or '').lower() if packed else ''


@contextmanager
def unpacked(path: Path, information: Mapping[str, Any]) -> Iterator[Path]:
    """Have a folder with the files of a bag, unpacked if they are compressed as a whole."""
    if compression_mode(information) != 'file':
        yield path
        return
    with scratch_folder() as folder:
        left, names = _MOST, []
        for file in files_of(path, information):
            names.append(file.stem)
            with (
                open_input(file, LARGEST_FILE) as packed,
                unpack_zstd(packed) as source,
                (folder / file.stem).open('xb') as target,
            ):
                while data := source.read(_PIECE):
                    left -= len(data)
                    if left < 0:
                        raise BagError(f'{path}: unpacked, it is larger than {_MOST >> 20} MiB')
                    target.write(data)
        plain = {
            **information, 'compression_mode': '', 'compression_format': '',
            'relative_file_paths': names,
        }  # fmt: skip
        (folder / 'metadata.yaml').write_text(yaml.safe_dump({_SECTION: plain}), encoding='utf-8')
        try:
            yield folder
        except BagError as error:
            raise BagError(str(error).replace(str(folder), str(path))) from None


def unpack_message(data: bytes) -> bytes:
    """Return a message that was compressed by itself; ValueError if it is too large."""
    content = unpack_zstd(BytesIO(data)).read(LARGEST_RECORD + 1)
    if len(content) > LARGEST_RECORD:
        raise ValueError(f'a message larger than {LARGEST_RECORD} bytes')
    return content
