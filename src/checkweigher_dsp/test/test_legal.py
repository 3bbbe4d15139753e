# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Digest of the software that decides masses and verdicts."""

from pathlib import Path
import shutil
import sys

import pytest

from checkweigher_dsp.legal import LIBRARIES, OWN, files_of, legal_software, package_digest


def test_the_digest_covers_each_byte_of_what_decides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    files = {name: path for package in OWN for name, path in files_of(package)}
    assert 'checkweigher_dsp/rejection/batch_rules.py' in files
    assert 'checkweigher_dsp/estimation/identifier.py' in files
    assert any('blas' in name for name, _ in files_of('numpy'))
    assert any('.so' in name for name, _ in files_of('pywt'))
    before = package_digest('checkweigher_dsp')
    for name, path in files_of('checkweigher_dsp'):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, tmp_path / name)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'checkweigher_dsp')
    copy = tmp_path / 'checkweigher_dsp/rejection/batch_rules.py'
    assert all(path.is_relative_to(tmp_path) for _, path in files_of('checkweigher_dsp'))
    assert package_digest('checkweigher_dsp') == before
    copy.write_bytes(copy.read_bytes().replace(b'1e-9', b'2e-9'))
    assert package_digest('checkweigher_dsp') != before


def test_the_digest_names_its_parts():
    parts = legal_software().parts
    assert {*OWN, *LIBRARIES, 'Python', 'BLAS kernel'} == parts.keys()
    assert parts['BLAS kernel'] not in ('', 'unknown')
