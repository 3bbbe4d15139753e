# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Creation and check of a certificate, and a login over TLS."""

from ipaddress import ip_address
import os
from pathlib import Path
import ssl
from urllib.request import HTTPSHandler, ProxyHandler, build_opener

from browsers import errors_of, needs_browser, open_browser
from cryptography import x509
from persons import Line, Person, add_users
import pytest
from selenium.webdriver.common.by import By
from served_page import served

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


@needs_browser
def test_a_person_logs_in_over_tls(tmp_path: Path):
    users, certificate, key = (tmp_path / name for name in ('users', 'page.crt', 'page.key'))
    add_users(users)
    make_certificate(['127.0.0.1'], certificate, key)
    files = '--users', str(users), '--certificate', str(certificate), '--key', str(key)
    with (
        served(*files) as (_, port),
        open_browser(tmp_path / 'browser', '--ignore-certificate-errors') as browser,
    ):
        person = Person(browser, Line(port, tmp_path, 'https'))
        person.log_in('anna')
        # The socket of the page also works over TLS.
        connected = 'return window.socket?.connected === true'
        person.until(lambda: browser.execute_script(connected))
        (cookie,) = browser.get_cookies()
        assert cookie['name'] == f'__Host-checkweigher-{port}'
        assert (cookie['secure'], cookie['httpOnly'], cookie['sameSite']) == (True, True, 'Strict')
        assert errors_of(browser) == []
        person.log_out()
        assert browser.get_cookies() == [] or all(
            each['name'] != cookie['name'] for each in browser.get_cookies()
        )
        assert browser.find_element(By.NAME, 'password')
        # A client that trusts the certificate needs no exception.
        trusted = ssl.create_default_context(cafile=str(certificate))
        opener = build_opener(ProxyHandler({}), HTTPSHandler(context=trusted))
        with opener.open(f'https://127.0.0.1:{port}/login') as answer:
            assert answer.status == 200
