# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the processor time of a line of one process goes: what each node does, by its thread.

    source setup/environment && python bench/stage_times.py [--items 200]

Nothing else should run meanwhile: a core that others use takes up to twice as long for the same.
"""

import argparse
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
import os
from pathlib import Path
import signal
import tempfile
import threading
import time
from typing import Any

from graph import parameters, write_line

from checkweigher_bringup import line
from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_core.ros.diagnostics import Diagnostics
from checkweigher_driver.source_stream import SourceStream
from checkweigher_dsp.nodes.denoise import DenoiseNode
from checkweigher_dsp.nodes.identifier import IdentifierNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.nodes.segmenter import SegmenterNode
from checkweigher_production.nodes.product import ProductNode

_SPACING = 0.35  # m, at 1.5 m/s
_SETTLED = 10.0  # s, until all have found each other and are warm
# What is timed, and its name in the table.
_TIMED: tuple[tuple[type, str, str], ...] = (
    (SourceStream, '_send', 'driver, all that follows'),
    (SourceStream, '_wait_until', 'driver: waits'),
    (SegmenterNode, '_on_event', 'segmenter'),
    (DenoiseNode, '_on_window', 'denoise'),
    (IdentifierNode, '_on_window', 'identifier'),
    (RejectNode, '_on_edge', 'reject: edge'),
    (RejectNode, '_on_record', 'reject'),
    (ProductNode, '_on_verdict', 'product: verdict'),
    (Diagnostics, '_publish', 'diagnostics, of each node'),
)
_OF_EVENTS = {'_send', '_on_event', '_on_record'}


class StageTimes:
    """How often methods are called, and how long their thread is at it."""

    def __init__(self) -> None:
        self.counts: defaultdict[str, int] = defaultdict(int)
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self.began = time.monotonic() + _SETTLED

    def watch(self, kind: type, method: str, name: str) -> None:
        """Time the calls of a method from now on."""
        plain: Callable[..., Any] = getattr(kind, method)

        @wraps(plain)
        def timed(itself: Any, *arguments: Any, **keywords: Any) -> Any:
            begin = time.thread_time()
            try:
                return plain(itself, *arguments, **keywords)
            finally:
                seconds = time.thread_time() - begin
                if time.monotonic() > self.began:
                    of_event = method in _OF_EVENTS and arguments
                    full = f'{name}: {type(arguments[0]).__name__}' if of_event else name
                    self.counts[full] += 1
                    self.seconds[full] += seconds

        setattr(kind, method, timed)

    def show(self, processor: float) -> None:
        """Print the table; `processor` s were spent in all since the line was settled."""
        elapsed = time.monotonic() - self.began
        print(f'{"what":38} {"each, us":>9} {"a second":>9} {"of a core":>10}')
        for name, count in sorted(self.counts.items()):
            seconds = self.seconds[name]
            share = f'{100 * seconds / elapsed:.2f} %'
            print(f'{name:38} {1e6 * seconds / count:9.0f} {count / elapsed:9.1f} {share:>10}')
        print(f'{"the process in all":58} {100 * processor / elapsed:8.2f} %')


def main() -> None:
    """Run a line on a bag at true time, then show the times."""
    parser = argparse.ArgumentParser(description='Where the processor time of a line goes.')
    parser.add_argument('--items', type=int, default=200, help='4.3 a second')
    given = parser.parse_args()
    times = StageTimes()
    for kind, method, name in _TIMED:
        times.watch(kind, method, name)
    settled: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        bag, file = Path(folder, 'bag'), Path(folder, 'line.yaml')
        write_line(bag, given.items, _SPACING)
        write_parameter_file(file, parameters(bag))
        times.began = time.monotonic() + _SETTLED
        waits = [
            threading.Timer(_SETTLED, lambda: settled.append(time.process_time())),
            threading.Timer(
                given.items * _SPACING / 1.5, os.kill, (os.getpid(), signal.SIGINT)
            ),  # before the bag ends
        ]
        for wait in waits:
            wait.start()
        with suppress(SystemExit):
            line.main(['stage_times', '--ros-args', '--params-file', str(file)])
    times.show(time.process_time() - settled[0])


if __name__ == '__main__':
    main()
