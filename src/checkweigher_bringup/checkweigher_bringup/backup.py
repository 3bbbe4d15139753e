# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Backup of a machine's folder as a tar archive of its files and their SHA-256.

`tar -xf` unpacks an archive, and `sha256sum -c SHA256SUMS` checks it without this program.
"""

from collections.abc import Iterator
import hashlib
from io import BytesIO
import os
from pathlib import Path, PurePosixPath
import shutil
import stat
import tarfile
import tempfile
from typing import IO, Any

from checkweigher_bringup.errors import UserError
from checkweigher_core.input_files import sha256_of
from checkweigher_core.state_files import replacing, sync_folder
from checkweigher_production.audit_log import head_path, read_consistent, read_log
from checkweigher_production.audit_words import conclusion

_SUMS = 'SHA256SUMS'
_FOLDER = 'machine'  # name of the machine folder in an archive


class _Hashed:
    """Reader of a binary file that computes the SHA-256 of the bytes that were read."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._sha256 = hashlib.sha256()

    def read(self, size: int) -> bytes:
        """Return the next `size` bytes of the file, or the rest of the file if it is shorter."""
        data = self._file.read(size)
        self._sha256.update(data)
        return data

    @property
    def digest(self) -> str:
        """Hexadecimal SHA-256 of the bytes that were read so far."""
        return self._sha256.hexdigest()


def write_backup(folder: Path, archive: Path) -> int:
    """Write a backup of a machine folder, and return the number of files.

    The line may run during the backup. The archive gets its name only after it is complete and on
    the disk. A file that changes during the backup is saved as it was at a single moment. The audit
    log and its head file are saved as they were at the same moment.

    Raises
    ------
    UserError
        If the folder does not exist, if it contains anything other than files and folders, or if
        the archive would be in the folder.
    AuditError
        If the audit log cannot be read.
    OSError
        If another file cannot be read, or the archive cannot be written.
    """
    if not folder.is_dir():
        raise UserError(f'{folder}: is not a folder')
    if archive.resolve().is_relative_to(folder.resolve()):
        raise UserError(f'{archive}: is in {folder}; write the backup to another place')
    with (
        replacing(archive, 0o600) as file,
        tarfile.open(fileobj=file, mode='w', format=tarfile.PAX_FORMAT) as tar,
    ):
        sums = dict(_add(tar, folder))
        lines = ''.join(f'{digest}  {path}\n' for path, digest in sums.items()).encode()
        tar.addfile(_entry(_SUMS, len(lines)), BytesIO(lines))
    return len(sums)


def _add(tar: tarfile.TarFile, folder: Path) -> Iterator[tuple[str, str]]:
    """Add a folder to an archive, and yield the name and the SHA-256 of each file.

    An ordinary file that is removed after the files were listed is left out. Raises the exceptions
    of `write_backup`, also if an audit log is removed.
    """
    tar.add(folder, _FOLDER, recursive=False)
    paths = sorted(folder.rglob('*'))
    heads = {head_path(path) for path in paths} & set(paths)
    head_bytes: dict[Path, bytes] = {}
    for path in paths:
        name = str(PurePosixPath(_FOLDER, path.relative_to(folder)))
        mode = _mode(path)
        if stat.S_ISDIR(mode):
            tar.add(path, name, recursive=False)
            continue
        if mode and not stat.S_ISREG(mode):
            raise UserError(f'{path}: is neither a file nor a folder, so it cannot be saved')
        if head_path(path) in heads:
            data, head_bytes[head_path(path)] = read_consistent(path)
        elif path in heads:  # the head was read with its log, which comes first in `paths`
            data = head_bytes[path]
        else:
            yield from _add_file(tar, path, name)
            continue
        tar.addfile(_entry(name, len(data), path.stat()), BytesIO(data))
        yield name, hashlib.sha256(data).hexdigest()


def _mode(path: Path) -> int:
    """Return the type and the permissions of a file, or 0 if it was removed.

    They are read at once, because the line may write a temporary file again at any time.
    """
    try:
        return path.lstat().st_mode
    except FileNotFoundError:
        return 0


def _add_file(tar: tarfile.TarFile, path: Path, name: str) -> Iterator[tuple[str, str]]:
    try:
        file = path.open('rb')
    except FileNotFoundError:  # a temporary file that the line has renamed is left out
        return
    with file:
        hashed = _Hashed(file)
        status = os.fstat(file.fileno())
        entry = _entry(name, status.st_size, status)
        tar.addfile(entry, hashed)  # type: ignore[arg-type]
    yield name, hashed.digest


def _entry(name: str, size: int, status: os.stat_result | None = None) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.size = size
    if status is not None:
        entry.mode, entry.mtime = status.st_mode & 0o777, status.st_mtime
    return entry


def restore_backup(archive: Path, folder: Path) -> int:
    """Restore a backup to a folder that is new or empty, and return the number of files.

    The folder gets its name only after all files have been compared with their SHA-256 in the
    archive, and are on the disk.

    Raises
    ------
    UserError
        If the archive is not a backup or is damaged, or if the folder is not empty.
    OSError
        If the archive cannot be read or the folder cannot be written.
    """
    if folder.is_dir() and any(folder.iterdir()):
        raise UserError(f'{folder}: is not empty; restore to a new folder')
    folder.parent.mkdir(parents=True, exist_ok=True)
    place = Path(tempfile.mkdtemp(prefix=f'.{folder.name}-', dir=folder.parent))
    try:
        try:
            with tarfile.open(archive, 'r:') as tar:
                tar.extractall(place, filter=_part_of_backup)
        except tarfile.TarError as error:
            raise UserError(f'{archive}: is not a backup, or is damaged: {error}') from None
        if not ((place / _SUMS).is_file() and (place / _FOLDER).is_dir()):
            raise UserError(f'{archive}: is not a backup of a machine')
        sums = _sums(place)
        files = [path for path in (place / _FOLDER).rglob('*') if path.is_file()]
        found = {str(path.relative_to(place)): sha256_of(path) for path in files}
        for name in sorted(found.keys() | sums.keys()):
            if found.get(name) != sums.get(name):
                raise UserError(f'{archive}: {name}: is not as it was saved')
        os.sync()
        os.replace(place / _FOLDER, folder)
    finally:
        shutil.rmtree(place)
    sync_folder(folder.parent)
    return len(found)


def _part_of_backup(entry: tarfile.TarInfo, place: str) -> tarfile.TarInfo:
    """Return an entry without its owner, so that the extracted file belongs to the current user.

    Only the permission bits of the mode are kept. This function is an extraction filter for
    `tarfile`. Raises `TarError` unless the entry is the file `SHA256SUMS`, or a file or folder of
    the machine folder.
    """
    parts = PurePosixPath(entry.name).parts
    is_kept = parts[:1] == (_FOLDER,) and '..' not in parts and (entry.isreg() or entry.isdir())
    if not is_kept and not (entry.name == _SUMS and entry.isreg()):
        raise tarfile.TarError(f'{entry.name!r} is not part of a backup')
    owner: Any = dict.fromkeys(('uid', 'gid', 'uname', 'gname'))
    return entry.replace(mode=entry.mode & 0o777, deep=False, **owner)


def _sums(place: Path) -> dict[str, str]:
    """Return the SHA-256 of each file by name, from `SHA256SUMS` of an unpacked backup."""
    lines = (place / _SUMS).read_text(encoding='utf-8', errors='replace').splitlines()
    return {name: digest for digest, _, name in (line.partition('  ') for line in lines)}


def print_log(log: Path) -> bool:
    """Print the state of an audit log, and return whether its hash chain is intact.

    Raises `AuditError` if the log cannot be read.
    """
    found = read_log(log)
    print(f'{log}: {conclusion(found)}')
    return found.whole
