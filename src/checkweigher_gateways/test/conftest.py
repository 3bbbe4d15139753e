# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line that runs, for the tests of the gateways."""

from collections.abc import Iterator
from pathlib import Path

from gateway_process import LANE, LINE, Verdicts
from node_process import spinning
import pytest
from served_page import line_of


@pytest.fixture(scope='module')
def verdicts(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Verdicts]:
    """Run a line, and listen to its verdicts as a node of the plant would."""
    folder: Path = tmp_path_factory.mktemp('line')
    with (
        line_of(folder / 'line.yaml', LINE, '--namespace', LANE),
        spinning() as spinner,
    ):
        yield Verdicts(spinner)
