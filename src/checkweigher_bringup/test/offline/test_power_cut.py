# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""State files after a power cut at each step of their writing."""

from collections.abc import Callable
import os
from pathlib import Path
import shutil
from typing import Any

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
import pytest

from checkweigher_core.records import NUMBERS_AT_ONCE, Decision, Verdict
from checkweigher_core.state_files import sync_folder
from checkweigher_driver.calibration.file import read_version, write_version
from checkweigher_driver.calibration.static_calibration import CalibrationPoint, calibrate
from checkweigher_driver.line_io.belt_record import BeltRecord, OnBelt
from checkweigher_dsp.estimation.learning.learner import ItemKind, LearnedKinds
from checkweigher_dsp.nodes.given_numbers import GivenNumbers
from checkweigher_dsp.nodes.learned_record import LearnedRecord
from checkweigher_production.audit_log import AuditLog, read_log
from checkweigher_production.audit_seal import add_seal, read_seals
from checkweigher_production.batch_record import RecordWriter, read_events
from checkweigher_web.access.users import Role, User, changing_users, read_users, write_users


class Disk:
    """Content of a folder on its disk, on which only synced files and folders are safe.

    After each step, `check` is called for two folders. One of them contains only the entries that
    were synced. The other one contains all entries, with contents that may be lost.
    """

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch, check: Callable[[Path], None]):
        self._root, self._check = root, check
        self._contents: dict[int, bytes] = {}
        self._entries: dict[int, dict[str, os.DirEntry[str]]] = {}
        self.steps = 0
        root.mkdir()
        self._sync(root)
        for name in ('open', 'mkdir', 'fsync', 'replace', 'pwrite'):
            monkeypatch.setattr(os, name, self._recorded(name, getattr(os, name)))

    def _recorded(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def record(*arguments: Any, **options: Any) -> Any:
            result = call(*arguments, **options)
            if (
                name == 'open' and arguments[1] & os.O_EXCL
            ):  # its inode may be that of a file that is gone
                self._contents.pop(os.fstat(result).st_ino, None)
            if name == 'fsync':
                self._sync(Path(os.readlink(f'/proc/self/fd/{arguments[0]}')))
            self.steps += 1
            self.cut()
            return result

        return record

    def _sync(self, path: Path) -> None:
        number = path.stat().st_ino
        if path.is_dir():
            self._entries[number] = {each.name: each for each in os.scandir(path)}
        else:
            self._contents[number] = path.read_bytes()

    def cut(self) -> None:
        """Check the state after a power cut at this moment."""
        with pytest.MonkeyPatch.context() as real:
            for name, call in REAL.items():
                real.setattr(os, name, call)
            for newest in (False, True):
                left = self._root.with_name('left')
                shutil.rmtree(left, ignore_errors=True)
                self._restore(self._root, left, newest=newest)
                self._check(left)

    def _restore(self, folder: Path, left: Path, *, newest: bool) -> None:
        left.mkdir()
        entries = self._entries.get(folder.stat().st_ino, {})
        for each in os.scandir(folder) if newest else entries.values():
            if each.is_dir():
                self._restore(Path(each.path), left / each.name, newest=newest)
            else:
                (left / each.name).write_bytes(self._contents.get(each.inode(), b''))
                (left / each.name).chmod(0o600)


REAL = {name: getattr(os, name) for name in ('open', 'mkdir', 'fsync', 'replace', 'pwrite')}
KEY = Ed25519PrivateKey.generate()


def write_user(path: Path, number: int) -> None:
    name = f'user{number}'
    with changing_users(path):
        users = read_users(path) if path.exists() else {}
        write_users(path, users | {name: User(name, Role.VIEWER, '$argon2id$x')})


def write_learned(path: Path, number: int) -> None:
    kinds = tuple(ItemKind(0.5, 0.1, 10, each) for each in range(number))
    record = LearnedRecord(str(path))
    record.write(LearnedKinds('mean {}', kinds), now=True)
    record.close()
    assert not record.trouble


def read_learned(path: Path) -> int:
    known = LearnedRecord(str(path)).read()
    assert known is not None
    return len(known.kinds)


def write_batch(path: Path, number: int) -> None:
    writer = RecordWriter(path.parent)
    if number == 1:
        writer.begin(path.stem, 'noon')
    else:
        writer.resume(path.stem)
        writer.write('verdict', Verdict(number, number, Decision.FAULT))
    writer.close()


def write_entry(path: Path, number: int) -> None:
    with AuditLog(path) as log:
        log.append('noon', '/product', 'reset', 'counts', None, number)


def read_entries(path: Path) -> int:
    found = read_log(path)
    assert found.whole
    return len(found.entries)


POINTS = [CalibrationPoint(0.0, 1000.0, 2.0), CalibrationPoint(1.0, 5000.0, 2.0)]
WRITERS: dict[str, tuple[Callable[[Path, int], object], Callable[[Path], int]]] = {
    'users': (write_user, lambda path: len(read_users(path))),
    'learned': (write_learned, read_learned),
    'seals': (
        lambda path, _: add_seal(path, Path('log'), (), KEY),
        lambda path: len(read_seals(path, KEY.public_key())),
    ),
    'cell.yaml': (
        lambda path, _: write_version(path, 'aed', calibrate(POINTS), POINTS),
        read_version,
    ),
    'L1.jsonl': (write_batch, lambda path: len(list(read_events(path)))),
    'audit.log': (write_entry, read_entries),
}


@pytest.mark.parametrize('name', WRITERS)
def test_a_file_is_the_old_or_the_new_one_and_the_new_one_once_written(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    write, read = WRITERS[name]
    allowed: tuple[int, ...] = (0,)

    def check(left: Path) -> None:
        path = left / 'checkweigher' / name
        assert (read(path) if path.exists() else 0) in allowed

    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'disk'))
    disk = Disk(tmp_path / 'disk', monkeypatch, check)
    if name not in ('users', 'learned'):  # which make their folder
        (tmp_path / 'disk/checkweigher').mkdir()
        sync_folder(tmp_path / 'disk')
    for number in (1, 2, 3):
        allowed = number - 1, number
        write(tmp_path / 'disk/checkweigher' / name, number)
        allowed = (number,)
        disk.cut()
    assert disk.steps >= 6


def test_no_number_of_an_item_is_given_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    given = 0

    def check(left: Path) -> None:
        path = left / 'items.numbers'
        last = GivenNumbers('/segmenter', 0, str(path)).last if path.exists() else 0
        again = (last // NUMBERS_AT_ONCE + 1) * NUMBERS_AT_ONCE if last else 1
        assert again > given

    disk = Disk(tmp_path / 'disk', monkeypatch, check)
    for first in (1, 990, 1990):  # the process starts again
        numbers = GivenNumbers('/segmenter', 0, str(tmp_path / 'disk/items.numbers'))
        for number in range(first, first + 20):
            numbers.give(number)
            given = number
            disk.cut()
        numbers.close()
    assert disk.steps > 60


def test_the_record_of_the_belt_knows_of_each_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    runs = False

    def check(left: Path) -> None:
        record = BeltRecord(left / 'belt')
        assert record.found.released or not runs
        record.close(record.found)

    disk = Disk(tmp_path / 'disk', monkeypatch, check)
    for _ in range(3):
        record = BeltRecord(tmp_path / 'disk/belt')
        assert not record.found.released
        record.keep(OnBelt(released=True))
        runs = True
        disk.cut()
        runs = False
        record.close(OnBelt())
    assert disk.steps > 12
