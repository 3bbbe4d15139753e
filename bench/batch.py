# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast offline work is: `weigh` of a long bag, and windows at once on all cores.

The figures are those of ``python bench/graph.py --only batch``.
"""

from functools import partial
import os
from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time

from figures import Figure, figure
from kernels import varied, windows_of
from loky import get_reusable_executor
from rosbags.rosbag2 import Reader

from checkweigher_core.records import NANOSECONDS, WeighWindow
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_validation.jobs import ONE_THREAD

COMMAND = [sys.executable, '-m', 'checkweigher_bringup.cli']
_LONG = 1.0  # s, of a measurement of windows
_MANY = 512  # windows


def batch_figures(repetitions: int, items: int = 3000) -> list[Figure]:
    """Return all figures: of a bag of `items`, and of windows at the slowest and fastest belt."""
    return [_weigh_speed(items, repetitions), *(_window_speed(s, repetitions) for s in (30, 90))]


def _speed(
    name: str, unit: str, target: float, values: list[float], references: list[float]
) -> Figure:
    """Return how often something was done in a second, beside what it is compared with."""
    reference = statistics.median(references)
    return figure(name, unit, values, target=target, more_is_better=True, reference=reference)


def _weigh_speed(items: int, repetitions: int) -> Figure:
    """Return how many times faster than real time a bag is weighed.

    From the start of the command to its end; the reference is to read the bag in one process, with
    rosbags and nothing else.
    """
    values, references = [], []
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, 'bag')
        simulate = ['simulate', '--speed', '90', '--mass', '134.5', '--count', str(items)]
        run([*simulate, '--output', str(bag)])
        for _ in range(repetitions):
            begin = time.perf_counter()
            with Reader(bag) as reader:
                for _ in reader.messages():
                    pass
                duration = reader.duration / NANOSECONDS
            references.append(duration / (time.perf_counter() - begin))
            begin = time.perf_counter()
            run(['weigh', str(bag)])
            values.append(duration / (time.perf_counter() - begin))
    return _speed('weigh', 'x real time', 1000.0, values, references)


def run(arguments: list[str]) -> None:
    """Run a command of the project, without its output."""
    subprocess.run([*COMMAND, *arguments], check=True, stdout=subprocess.DEVNULL)


def _window_speed(speed: int, repetitions: int) -> Figure:
    """Return windows a second of a belt speed in m/min, on all cores; reference: one core."""
    windows = windows_of(speed)
    cores = len(os.sched_getaffinity(0))
    all_cores: list[float] = []
    one_core: list[float] = []
    for _ in range(repetitions):
        for count, values in ((cores, all_cores), (1, one_core)):
            processes = get_reusable_executor(count, env=ONE_THREAD)
            values.append(sum(processes.map(partial(_windows_a_second, windows), range(count))))
    return _speed(f'windows {speed} m/min', '1/s', 5000.0, all_cores, one_core)


def _windows_a_second(windows: list[WeighWindow], seed: int) -> float:
    many = varied(windows, _MANY, seed)
    denoiser, identifier = Denoiser(DenoiseParameters()), Identifier(IdentifierParameters())
    identifier.estimate_all(denoiser.denoise_all(many))
    begin, done = time.perf_counter(), 0
    while time.perf_counter() - begin < _LONG:
        identifier.estimate_all(denoiser.denoise_all(many))
        done += _MANY
    return done / (time.perf_counter() - begin)
