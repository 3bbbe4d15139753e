# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The certificate that the command makes, and the check of one's own."""

from ipaddress import ip_address
import os
from pathlib import Path

from cryptography import x509
import pytest

from checkweigher_core.whole_file import OutputError
from checkweigher_web.access.certificate import CertificateError, check_pair, make_certificate


def test_a_certificate_names_host_and_address_and_fits_its_key(tmp_path: Path):
    certificate, key = tmp_path / 'page.crt', tmp_path / 'page.key'
    made = make_certificate(['scale7.local', '192.168.1.7'], certificate, key)
    check_pair(certificate, key)
    assert os.stat(key).st_mode & 0o777 == 0o600
    found = x509.load_pem_x509_certificate(certificate.read_bytes())
    names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ['scale7.local']
    assert names.get_values_for_type(x509.IPAddress) == [ip_address('192.168.1.7')]
    assert len(made.split(':')) == 32

    key.chmod(0o644)
    with pytest.raises(CertificateError, match=f'may use it; run: chmod 600 {key}'):
        check_pair(certificate, key)
    key.chmod(0o600)

    with pytest.raises(OutputError, match='exists already'):
        make_certificate(['other'], certificate, tmp_path / 'other.key')
    make_certificate(['other'], tmp_path / 'other.crt', tmp_path / 'other.key')
    for wrong in (tmp_path / 'other.key', certificate, tmp_path / 'nowhere'):
        with pytest.raises(CertificateError):
            check_pair(certificate, wrong)


def test_a_name_that_is_none_is_refused(tmp_path: Path):
    with pytest.raises(CertificateError):
        make_certificate(['jürgen.local'], tmp_path / 'a.crt', tmp_path / 'a.key')
    assert not list(tmp_path.iterdir())
