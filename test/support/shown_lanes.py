# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes of the page that have seen a recording and its verdicts."""

from checkweigher_core.recording import Recording
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import weigh
from checkweigher_web.lane import SHOWN, Lane

_DEFAULTS = LineParameters()


def lane_of(
    recording: Recording, parameters: LineParameters = _DEFAULTS, held: float = SHOWN
) -> Lane:
    """Return a lane that has seen all events of a recording and what became of its items."""
    lane = Lane('a', held)
    lane.take(recording.load_cell)
    for event in (*recording.blocks, *recording.edges, *recording.references):
        lane.take(event)
    for result in weigh(recording, parameters):
        lane.take(result.verdict)
        lane.take(result.estimate)
    return lane
