# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page greys what is old: of a line that is silent, and of a server that has died."""

import os
from pathlib import Path
import re
import signal

from browsers import needs_browser, shortcomings, text_of, until
from selenium.webdriver import Chrome
from served_page import child_of, line_of, served

pytestmark = needs_browser
LINE = {'driver': {'source': 'simulator', 'simulator': {'count': 0, 'seed': 3}}}


def test_what_is_old_is_grey_and_says_since_when(browser: Chrome, tmp_path: Path):
    def note() -> str:
        return text_of(browser, 'body.stale .late')

    with line_of(tmp_path / 'line.yaml', LINE) as line, served() as (page, port):
        browser.get(f'http://127.0.0.1:{port}/lane/')  # others may linger in the domain
        until(browser, lambda: text_of(browser, '.mass').endswith(' g'))
        until(browser, lambda: not note())
        silent = child_of(line.pid)
        for process, ending in ((silent, signal.SIGKILL), (page.pid, signal.SIGSTOP)):
            os.kill(process, signal.SIGSTOP)
            until(browser, lambda: re.match(r'No news since \d\d:\d\d:\d\d, for ', note()))
            assert shortcomings(browser) == []
            os.kill(process, ending)
            if process == silent:  # it is started again
                until(browser, lambda: not note())
