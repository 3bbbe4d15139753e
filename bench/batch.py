# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How fast offline work is: `weigh` of a long bag, and windows at once on all cores.

The figures are those of ``python bench/graph.py --only batch``.
"""

from dataclasses import dataclass
from functools import partial
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from kernels import varied, windows_of
from loky import get_reusable_executor
from rosbags.rosbag2 import Reader

from checkweigher_core.records import NANOSECONDS, WeighWindow
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_validation.jobs import ONE_THREAD

_COMMAND = [sys.executable, '-m', 'checkweigher_bringup.cli']
_LONG = 1.0  # s, of a measurement of windows
_MANY = 512  # windows


@dataclass(frozen=True, slots=True)
class Speeds:
    """How often something was done in a second, and how often what it is compared with."""

    name: str
    unit: str
    target: float
    values: list[float]
    references: list[float]


def batch_speeds(repetitions: int, items: int = 3000) -> list[Speeds]:
    """Return all figures: of a bag of `items`, and of windows at the slowest and fastest belt."""
    return [_weigh_speeds(items, repetitions), *(_window_speeds(s, repetitions) for s in (30, 90))]


def _weigh_speeds(items: int, repetitions: int) -> Speeds:
    """Return how many times faster than real time a bag is weighed.

    From the start of the command to its end; the reference is to read the bag in one process, with
    rosbags and nothing else.
    """
    speeds = Speeds('weigh', 'x real time', 1000.0, [], [])
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder, 'bag')
        simulate = ['simulate', '--speed', '90', '--mass', '134.5', '--count', str(items)]
        _run([*simulate, '--output', str(bag)])
        for _ in range(repetitions):
            begin = time.perf_counter()
            with Reader(bag) as reader:
                for _ in reader.messages():
                    pass
                duration = reader.duration / NANOSECONDS
            speeds.references.append(duration / (time.perf_counter() - begin))
            begin = time.perf_counter()
            _run(['weigh', str(bag)])
            speeds.values.append(duration / (time.perf_counter() - begin))
    return speeds


def _run(arguments: list[str]) -> None:
    subprocess.run([*_COMMAND, *arguments], check=True, stdout=subprocess.DEVNULL)


def _window_speeds(speed: int, repetitions: int) -> Speeds:
    """Return windows a second of a belt speed in m/min, on all cores; reference: one core."""
    windows = windows_of(speed)
    cores = len(os.sched_getaffinity(0))
    speeds = Speeds(f'windows {speed} m/min', '1/s', 5000.0, [], [])
    for _ in range(repetitions):
        for count, values in ((cores, speeds.values), (1, speeds.references)):
            processes = get_reusable_executor(count, env=ONE_THREAD)
            values.append(sum(processes.map(partial(_windows_a_second, windows), range(count))))
    return speeds


def _windows_a_second(windows: list[WeighWindow], seed: int) -> float:
    many = varied(windows, _MANY, seed)
    denoiser, identifier = Denoiser(DenoiseParameters()), Identifier(IdentifierParameters())
    identifier.estimate_all(denoiser.denoise_all(many))
    begin, done = time.perf_counter(), 0
    while time.perf_counter() - begin < _LONG:
        identifier.estimate_all(denoiser.denoise_all(many))
        done += _MANY
    return done / (time.perf_counter() - begin)
