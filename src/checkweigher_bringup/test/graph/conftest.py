# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures for the tests of the graph."""

from collections.abc import Iterator
import os
from pathlib import Path

from product_line import Line
import pytest
from rclpy.logging import initialize

from checkweigher_bringup.spinning import Spinner, spinning

# The log of the nodes of this process goes to standard output. pytest captures nothing between the
# set-up, the test and its end, and a worker has its standard error from the terminal of the dots.
_LOG = {'RCUTILS_LOGGING_USE_STDOUT': '1', 'RCUTILS_LOGGING_BUFFERED_STREAM': '0'}
os.environ |= _LOG
initialize()
for _name in _LOG:  # the processes that tests start keep to standard error
    del os.environ[_name]


@pytest.fixture
def spinner(request: pytest.FixtureRequest) -> Iterator[Spinner]:
    """Spin nodes in the namespace `LANE` of the test module, by default lane1."""
    with spinning(getattr(request.module, 'LANE', 'lane1')) as running:
        yield running


@pytest.fixture
def line(spinner: Spinner, tmp_path: Path) -> Line:
    """Return a line with a product node and an operator."""
    return Line(spinner, tmp_path)
