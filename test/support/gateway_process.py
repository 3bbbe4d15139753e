# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A gateway in a process of its own, as a user starts it, and the verdicts of its line."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
import re
import subprocess
import time

from running import PATIENCE, children, start_command, wait_for
import yaml

from checkweigher_core.records import Verdict
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.spinner import Spinner

LANE = 'lane1'
MODULE = 'checkweigher_gateways.gateway'
# A fast simulated line, of which some items are too light.
LINE: dict[str, dict[str, object]] = {
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
    'reject': {'max_rejects_in_a_row': 6},
}


PRODUCTS = {
    'light': {'nominal': 0.2, 'lower_limit': 0.19, 'upper_limit': 0.21},
    'heavy': {'nominal': 0.3, 'lower_limit': 0.29, 'upper_limit': 0.31},
}


def line_values(folder: Path) -> dict[str, dict[str, object]]:
    """Return the parameters of the line, with its recipes in a folder and its audit log there."""
    recipes = folder / 'recipes.yaml'
    recipes.write_text(yaml.safe_dump({'products': PRODUCTS}))
    log = str(folder / 'audit.log')
    product = {'recipes': str(recipes), 'product': 'light', 'audit_log': log}
    return {**LINE, 'product': product}


class Verdicts(PortNode):
    """Node of the plant that takes the verdicts of the line, without those before it came."""

    def __init__(self, spinner: Spinner, folder: Path, line: int) -> None:
        super().__init__('plant', namespace=f'/{LANE}')
        self.folder, self._line = folder, line
        self.taken: list[Verdict] = []
        self.subscribe(ports.VERDICT, self.taken.append)
        spinner.add(self)

    def gateway(self) -> int:
        """Return the process of the gateway that runs beside the line, 0 while there is none."""
        for child in children(self._line):
            with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
                if MODULE in Path(f'/proc/{child}/cmdline').read_text(encoding='utf-8'):
                    return child
        return 0

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
