# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the tests of the page."""

from collections.abc import Iterator

from browsers import open_browser
import pytest
from selenium.webdriver import Chrome


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """Open one browser for all tests of a module."""
    with open_browser(tmp_path_factory.mktemp('browser')) as driver:
        yield driver
