# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""All measurements, one after the other: the kernels, then the graph."""

import argparse
from pathlib import Path
import subprocess
import sys

HERE = Path(__file__).parent
PARTS = ('kernels', 'graph')
_QUICK = {'kernels': ['--repetitions', '3'], 'graph': ['--quick']}


def main() -> None:
    """Run the parts that were asked for; the exit status is that of the first that failed."""
    parser = argparse.ArgumentParser(description='Measure the kernels and the graph.')
    parser.add_argument('--part', choices=PARTS, help='only this one')
    parser.add_argument('--only', default='', help='cases of that part whose name has this in it')
    parser.add_argument('--quick', action='store_true', help='a minute or two, and less certain')
    parser.add_argument('--json', type=Path, help='folder for kernels.json and graph.json')
    given = parser.parse_args()
    if given.only and not given.part:
        parser.error('--only needs --part')
    for part in [given.part] if given.part else PARTS:
        command = [sys.executable, str(HERE / f'{part}.py'), '--only', given.only]
        command += _QUICK[part] if given.quick else []
        if given.json:
            given.json.mkdir(parents=True, exist_ok=True)
            command += ['--json', str(given.json / f'{part}.json')]
        print(f'-- {part}', flush=True)
        if status := subprocess.call(command):
            sys.exit(status)


if __name__ == '__main__':
    main()
