# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Passes of known mass on simulated lines, for the tests of tuning."""

from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters
from checkweigher_validation.accuracy.passes import SpeedGroup, group_by_speed, known_passes


def groups_of(*speeds: float, **parameters: object) -> tuple[SpeedGroup, ...]:
    """Return the passes of a line at some speeds in m/s, by speed."""
    passes = []
    for speed in speeds:
        line = Simulation(SimulationParameters.from_mapping(parameters | {'speed': speed}))
        passes += known_passes(line.load_cell, line, SegmenterParameters())
    return group_by_speed(passes)


def group_of(speed: float = 1.0, **parameters: object) -> SpeedGroup:
    """Return the passes of a line at one speed in m/s."""
    (group,) = groups_of(speed, **parameters)
    return group
