# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Backup of a machine's folder in an archive that standard tools check, and its restore."""

from collections.abc import Callable
import json
import os
from pathlib import Path
import shutil
import subprocess
import tarfile
import threading

from here import refused, run_here
import pytest
from running import BAGS, read_rows

from checkweigher_bringup.backup import write_backup
from checkweigher_bringup.commissioning.machine_folder import MachineFolder
from checkweigher_production.audit_log import AuditLog, read_log

TIME = '2026-05-28T06:00:00.000000+00:00'
TRAINED = """
/**/identifier:
  ros__parameters:
    estimator: iswd_eksi
    iswd_eksi.process_noise: 0.0113
"""


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """Return a folder with a training, an audit log of two entries and a kept item."""
    folder = MachineFolder.made(tmp_path / 'lane1').path
    (folder / 'machine.yaml').write_text(TRAINED)
    shutil.copytree(BAGS / 'paper_60', folder / 'kept/item_1')
    (folder / 'batches/empty').mkdir(parents=True)
    with AuditLog(folder / 'audit.log') as log:
        for limit in (0.14, 0.15):
            log.append(TIME, '/product', 'parameter', 'reject.lower_limit', None, limit)
    return folder


def content(folder: Path) -> dict[str, bytes | None]:
    """Return the bytes of each file below a folder, and None for each folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob('*')
    }


def saved(machine: Path) -> Path:
    archive = machine.parent / 'backup.tar'
    done = run_here('backup', machine, '--output', archive)
    assert done.returncode == 0, done.stderr
    assert 'the chain is whole: 2 entries' in done.stdout
    return archive


def masses(folder: Path, csv: Path) -> bytes:
    done = run_here('weigh', BAGS / 'paper_60', '--params', folder / 'machine.yaml', '--csv', csv)
    assert done.returncode == 0, done.stderr
    assert len(read_rows(csv)) == 25
    return csv.read_bytes()


def test_a_restored_folder_gives_the_same_masses_and_its_log_says_so(machine: Path, tmp_path: Path):
    before = content(machine)
    weighed = masses(machine, tmp_path / 'before.csv')
    archive = saved(machine)
    shutil.rmtree(machine)
    restored = tmp_path / 'elsewhere/lane1'
    done = run_here('restore', archive, '--folder', restored, '--who', 'ann')
    assert (done.returncode, done.stderr) == (0, '')
    assert 'entry 3 of the audit log, on this restore' in done.stdout
    assert masses(restored, tmp_path / 'after.csv') == weighed
    log = read_log(restored / 'audit.log')
    assert log.whole
    assert [entry.kind for entry in log.entries] == ['parameter', 'parameter', 'backup']
    assert (log.entries[-1].who, log.entries[-1].new['file']) == ('claimed:ann', 'backup.tar')
    assert (restored / 'audit.log').read_bytes().startswith(before['audit.log'])
    after = content(restored)
    for name in ('audit.log', 'audit.log.head'):
        del before[name], after[name]
    assert after == before


def test_standard_tools_check_an_archive(machine: Path, tmp_path: Path):
    archive = saved(machine)
    (tmp_path / 'unpacked').mkdir()
    subprocess.run(['tar', '-xf', archive], cwd=tmp_path / 'unpacked', check=True)
    subprocess.run(
        ['sha256sum', '--check', '--strict', '--quiet', 'SHA256SUMS'],
        cwd=tmp_path / 'unpacked', check=True,
    )  # fmt: skip


def test_the_audit_log_of_a_line_that_runs_is_whole_in_each_backup(machine: Path, tmp_path: Path):
    ends = threading.Event()

    def run() -> None:
        with AuditLog(machine / 'audit.log') as log:
            while not ends.is_set():
                log.append(TIME, '/product', 'parameter', 'reject.lower_limit', 0.1, 0.2)

    line = threading.Thread(target=run)
    line.start()
    try:
        for number in range(10):
            write_backup(machine, archive := tmp_path / f'{number}.tar')
            with tarfile.open(archive) as tar:
                tar.extractall(tmp_path / f'{number}', filter='data')
            log = read_log(tmp_path / f'{number}/machine/audit.log')
            assert log.whole, log.reason
    finally:
        ends.set()
        line.join()
    assert len(log.entries) > 2


def flipped(archive: Path) -> None:
    data = archive.read_bytes()
    at = data.index(b'0.0113')
    archive.write_bytes(data[:at] + b'0.0114' + data[at + 6 :])


def cut(archive: Path) -> None:
    archive.write_bytes(archive.read_bytes()[:100_000])


def without_a_file(archive: Path) -> None:
    subprocess.run(['tar', '--delete', '-f', archive, 'machine/recipes.yaml'], check=True)


def with_a_link(archive: Path) -> None:
    entry = tarfile.TarInfo('machine/link')
    entry.type, entry.linkname = tarfile.SYMTYPE, '/etc/passwd'
    with tarfile.open(archive, 'a') as tar:
        tar.addfile(entry)


def with_a_linked_folder(archive: Path) -> None:
    entry = tarfile.TarInfo('machine/link')
    entry.type, entry.linkname = tarfile.SYMTYPE, '/etc'
    with tarfile.open(archive, 'a') as tar:
        tar.addfile(entry)


def with_a_way_out(archive: Path) -> None:
    with tarfile.open(archive, 'a') as tar:
        tar.addfile(tarfile.TarInfo('machine/../../out'))


@pytest.mark.parametrize(
    'damage', [flipped, cut, without_a_file, with_a_link, with_a_linked_folder, with_a_way_out]
)
def test_a_damaged_backup_is_refused_and_leaves_nothing(
    damage: Callable[[Path], None], machine: Path, tmp_path: Path
):
    damage(archive := saved(machine))
    before = content(tmp_path)
    assert str(archive) in refused('restore', archive, '--folder', tmp_path / 'new')
    assert content(tmp_path) == before


def test_nothing_is_overwritten(machine: Path, tmp_path: Path):
    archive = saved(machine)
    before = content(tmp_path)
    assert 'is not empty' in refused('restore', archive, '--folder', machine)
    assert 'write the backup to another place' in refused(
        'backup', machine, '--output', machine / 'kept/backup.tar'
    )
    assert 'is not a folder' in refused('backup', tmp_path / 'no', '--output', tmp_path / 'x.tar')
    assert content(tmp_path) == before


def test_what_an_archive_cannot_hold_is_named(machine: Path, tmp_path: Path):
    os.symlink(tmp_path, machine / 'kept/link')
    before = content(tmp_path)
    said = refused('backup', machine, '--output', tmp_path / 'backup.tar')
    assert 'kept/link: is neither a file nor a folder' in said
    assert content(tmp_path) == before


def test_a_broken_log_is_restored_and_called_broken(machine: Path, tmp_path: Path):
    (machine / 'audit.log.head').write_text(json.dumps({}))
    archive = tmp_path / 'backup.tar'
    for words in (
        ('backup', machine, '--output', archive),
        ('restore', archive, '--folder', tmp_path / 'new'),
    ):
        done = run_here(*words)
        assert done.returncode == 1
        assert 'BROKEN: ' in done.stdout
    assert content(tmp_path / 'new') == content(machine)
