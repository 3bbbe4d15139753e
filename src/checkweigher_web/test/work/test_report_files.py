# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Addresses of reports, which work for each batch name and reach no other file."""

from collections.abc import Iterator
from pathlib import Path
import socket
from threading import Thread
from types import SimpleNamespace
from urllib.parse import quote

from fastapi import FastAPI
import pytest
from served_page import get, get_text
import uvicorn

from checkweigher_production.batch_record import record_path
from checkweigher_validation.verification.plan import VERIFICATIONS
from checkweigher_web.work.reports import add_reports


@pytest.fixture(scope='module')
def machine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with batches, a verification, and reports outside their folders."""
    tmp_path = tmp_path_factory.mktemp('files')
    for folder in ('machine/batches', f'machine/{VERIFICATIONS}/one'):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / 'report.html').write_text('of this verification')
    for folder in (tmp_path, tmp_path / 'machine', tmp_path / 'machine' / VERIFICATIONS):
        (folder / 'report.html').write_text('outside')
        (folder / 'x.html').write_text('outside')
        (folder / 'x.jsonl').touch()
    return tmp_path / 'machine'


@pytest.fixture(scope='module')
def port(machine: Path) -> Iterator[int]:
    services = SimpleNamespace(
        batch_folder=machine / 'batches', verification=SimpleNamespace(folder=str(machine))
    )
    app, workshop = FastAPI(), SimpleNamespace(lanes={'': services})
    add_reports(app, workshop, 'sandbox')
    server = uvicorn.Server(uvicorn.Config(app, log_level='error'))
    with socket.create_server(('127.0.0.1', 0)) as listener:
        thread = Thread(target=server.run, args=([listener],))
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join()


@pytest.mark.parametrize('batch', ['L1', '.L1', '..', '.', '/L1', '../L1', 'a.b', '50 %', 'ü?#&"'])
def test_the_report_of_any_batch_is_given(port: int, machine: Path, batch: str):
    record = record_path(machine / 'batches', batch)
    record.touch()
    record.with_suffix('.html').write_text(batch)
    address = f'/reports/batch/{quote(record.stem, safe="")}.html'
    assert get_text(port, address) == batch


def test_a_verification_is_found_by_its_folder(port: int):
    assert get_text(port, '/reports/verification/one.html') == 'of this verification'


@pytest.mark.parametrize(
    'path',
    [
        'batch/../x.html', 'batch/..%2Fx.html', 'batch/%2e%2e%2fx.html', 'batch/..%252Fx.html',
        'batch/....%2Fx.html', 'batch/%2Fetc%2Fpasswd.html', 'batch/x%00.html', 'batch/..%5Cx.html',
        'verification/..html', 'verification/...html', 'verification/%2e%2e.html',
        'verification/..%2F..html', 'verification/one%2F...html', 'verification/.html',
        'batch/report.html', 'verification/one.yaml', 'other/one.html',
    ],
)  # fmt: skip
def test_what_is_no_report_is_not_given(port: int, path: str):
    assert get(port, f'/reports/{path}').status == 404
