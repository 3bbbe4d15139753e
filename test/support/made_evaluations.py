# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Conditions and evaluations whose statistics are known by construction."""

from dataclasses import replace
import itertools
import math

import numpy as np

from checkweigher_validation.accuracy.errors import ConditionResult, Evaluation
from checkweigher_validation.accuracy.examples import Example


def make_condition(
    errors,
    estimator='mean',
    speed=1.0,
    mass=0.1645,
    part='test',
    std_devs=None,
    faults=0,
    bound=math.nan,
):
    """Build a condition from errors in kg; without std_devs each states 0.1 g."""
    errors = np.array(errors, dtype=np.float64)
    stated = np.full(len(errors), 1e-4) if std_devs is None else np.array(std_devs, np.float64)
    return ConditionResult(estimator, speed, mass, part, errors, stated, faults, bound)


def errors_with(mean, std_dev, count=60):
    """Errors, half above and half below their mean, whose statistics are exactly these."""
    # The deviations are all of one size d: sigma^2 = n d^2 / (n - 1).
    size = std_dev * math.sqrt((count - 1) / count)
    return mean + size * np.where(np.arange(count) % 2, 1.0, -1.0)


PAPER_SPEEDS = (0.5, 0.75, 1.0, 1.25, 1.5)  # m/s
PAPER_MASSES = (0.0745, 0.1345, 0.1645, 0.1945, 0.2545)  # kg


def make_evaluation(
    speeds=PAPER_SPEEDS,
    masses=PAPER_MASSES,
    estimators=('hann', 'iswd_eksi'),
    parts=('train', 'test'),
    examples=(),
    bound=2e-5,
    title='A line <of> tests & more',
):
    """Build an evaluation in which the n-th estimator has sigma n * 0.05 v g and mu n * 0.01 g.

    v is the speed in m/s, n counts from 1; mu is negative in training. The bound is 0.02 g.
    """
    conditions = []
    for number, name in enumerate(estimators, start=1):
        for part, speed, mass in itertools.product(parts, speeds, masses):
            mean = (-1 if part == 'train' else 1) * number * 1e-5
            errors = errors_with(mean, number * 5e-5 * speed)
            conditions.append(make_condition(errors, name, speed, mass, part, bound=bound))
    provenance = (('profile', 'paper'), ('seed', '1 & 2'))
    return Evaluation(title, tuple(conditions), provenance, examples)


def make_example(speed=1.5, mass=0.2545, with_ideal=True):
    """Build a pass of 0.4 s that rises, rests and falls, with a line of 40 Hz and 1 g on it."""
    rate = 960.0
    time = np.arange(384) / rate
    t1, t2, t3, t4 = (0.1 + way / speed for way in (0.0, 0.1, 0.2, 0.3))
    ideal = mass * np.interp(time, (t1, t2, t3, t4), (0.0, 1.0, 1.0, 0.0))
    signal = ideal + 1e-3 * np.sin(2 * np.pi * 40 * time)
    example = Example(
        speed, mass, rate, t1, t2, t3, t4, signal, ideal if with_ideal else np.zeros(0)
    )
    window = signal[example.window]
    kinds = tuple((name, window + shift) for name, shift in (('hard', 1e-4), ('shrinkage', 2e-4)))
    names = ('a7', 'd7', 'd6', 'd5', 'd4', 'd3', 'd2', 'd1')
    bands = tuple((name, signal / (2 + number)) for number, name in enumerate(names))
    return replace(example, denoised=kinds, bands=bands)
