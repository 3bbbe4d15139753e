# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A line that runs, for the tests of the gateways."""

from collections.abc import Iterator
from pathlib import Path

from gateway_process import LANE, Verdicts, line_values
from node_process import spinning
import pytest
from served_page import line_of
import yaml


@pytest.fixture(scope='module')
def verdicts(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Verdicts]:
    """Run a line, and listen to its verdicts as a node of the plant would.

    A module with `GATEWAYS`, sections of settings, has these gateways run beside the line.
    """
    folder: Path = tmp_path_factory.mktemp('line')
    gateways = folder / 'gateways.yaml'
    gateways.write_text(yaml.safe_dump(getattr(request.module, 'GATEWAYS', {})))
    options = '--namespace', LANE, '--gateways', str(gateways)
    with (
        line_of(folder / 'line.yaml', line_values(folder), *options) as line,
        spinning() as spinner,
    ):
        yield Verdicts(spinner, folder, line.pid)
