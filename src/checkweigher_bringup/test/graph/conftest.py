# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the tests of the graph."""

from collections.abc import Iterator
from pathlib import Path

from product_line import Line
import pytest

from checkweigher_bringup.spinning import Spinner, spinning


@pytest.fixture
def spinner(request: pytest.FixtureRequest) -> Iterator[Spinner]:
    """Serve nodes in the namespace `LANE` of the module of the test, by default lane1."""
    with spinning(getattr(request.module, 'LANE', 'lane1')) as running:
        yield running


@pytest.fixture
def line(spinner: Spinner, tmp_path: Path) -> Line:
    """Return a line with a product node and an operator."""
    return Line(spinner, tmp_path)
