# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Simulated line with feedback from the scale to the filler."""

from collections.abc import Iterator

from checkweigher_core.recording import Event
from checkweigher_core.records import EyeEdge, SampleBlock
from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_production.filler_feedback import FillerController
from checkweigher_production.recipes import Product
from checkweigher_recording.simulation.simulator import Simulation


def with_feedback(simulation: Simulation, product: Product) -> Iterator[Event]:
    """Yield the events of a simulated line, and pass each correction of the feedback to its filler.

    `product` is the recipe of the line.

    Raises `ValueError` at the first event if the recipe has no settings of the feedback.
    """
    if product.filler is None:
        raise ValueError(f'{product.name}: its recipe has no filler')
    controller = FillerController(product.filler, product.name, product.nominal, product.tare)
    line = WeighingLine(simulation.load_cell, LineParameters().with_values(product.stage_values()))
    for event in simulation:
        yield event
        if not isinstance(event, SampleBlock | EyeEdge):
            continue
        for weighing in line.add(event):
            feedback = controller.add(weighing.verdict)
            if feedback is not None and simulation.filler is not None:
                simulation.filler.correction = feedback.correction
