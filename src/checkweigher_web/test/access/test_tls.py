# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Login over TLS in a real browser, with a certificate that the command makes."""

from pathlib import Path
import ssl
from urllib.request import HTTPSHandler, ProxyHandler, build_opener

from browsers import errors_of, needs_browser, open_browser
from persons import Line, Person, add_users
from selenium.webdriver.common.by import By
from served_page import served

from checkweigher_web.access.certificate import make_certificate


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
        # Its socket is there as well: the page follows its timer.
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
        # Whoever trusts the certificate needs no exception.
        trusted = ssl.create_default_context(cafile=str(certificate))
        opener = build_opener(ProxyHandler({}), HTTPSHandler(context=trusted))
        with opener.open(f'https://127.0.0.1:{port}/login') as answer:
            assert answer.status == 200
