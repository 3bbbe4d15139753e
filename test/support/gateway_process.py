# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A gateway in a process of its own, as a user starts it, and the verdicts of its line."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
import re
import subprocess
import time

from running import PATIENCE, start_command, wait_for
import yaml

from checkweigher_core.records import Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

LANE = 'lane1'
# A fast simulated line, of which some items are too light.
LINE = {
    'driver': {
        'source': 'simulator',
        'simulator': {
            'count': 0,
            'seed': 3,
            'lead_in': 1.0,
            'spacing': 0.4,
            'masses': [0.2, 0.05, 0.2],
        },
    },
    'reject': {'lower_limit': 0.1, 'upper_limit': 0.3},
}


class Verdicts(PortNode):
    """Node of the plant that takes the verdicts of the line, without those before it came."""

    def __init__(self, spinner: Spinner) -> None:
        super().__init__('plant', namespace=f'/{LANE}')
        self.taken: list[Verdict] = []
        self.subscribe(ports.VERDICT, self.taken.append)
        spinner.add(self)

    def more(self, count: int) -> list[Verdict]:
        """Wait for further verdicts, and return them."""
        before = len(self.taken)
        wait_for(lambda: len(self.taken) >= before + count, f'{count} verdicts', 2 * PATIENCE)
        return self.taken[before:]

    def go_on(self) -> None:
        """Check that the line gives its verdicts in time, whatever the gateways do."""
        began, numbers = time.monotonic(), [each.item_id for each in self.more(3)]
        assert numbers == list(range(numbers[0], numbers[0] + 3))
        assert time.monotonic() - began < PATIENCE


@contextmanager
def gateway(
    kind: str, folder: Path, settings: Mapping[str, object], *options: object
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a gateway with the settings of its section; give its process and its address."""
    file = folder / f'{kind}.yaml'
    file.write_text(yaml.safe_dump({kind: dict(settings)}))
    process = start_command('gateway', kind, '--settings', file, *options, stdout=None)
    try:
        line = process.stderr.readline()
        found = re.fullmatch(rf'gateway {kind}: (.*)\n', line)
        assert found, line
        yield process, found[1]
    finally:
        process.kill()
        process.wait()
        process.stderr.close()
