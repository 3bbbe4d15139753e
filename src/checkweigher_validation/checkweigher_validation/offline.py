"""Weighing recordings without the graph."""

from collections.abc import Iterator

from checkweigher_driver.block_cutting import join
from checkweigher_driver.progress import with_progress
from checkweigher_driver.recording import Recording
from checkweigher_dsp.line import LineParameters, WeighingLine
from checkweigher_dsp.records import EyeEdge, Reference, SampleBlock
from checkweigher_validation.results import ItemResult, join_all


def weigh(
    recording: Recording, parameters: LineParameters, *, progress: bool = False
) -> list[ItemResult]:
    """Weigh everything in a recording.

    Parameters
    ----------
    recording : Recording
        Samples, edges and known masses.
    parameters : LineParameters
        Of all stages.
    progress : bool
        Whether to show a bar on a terminal if it takes more than two seconds.

    Returns
    -------
    list of ItemResult
        In order of entry.
    """
    line = WeighingLine(recording.load_cell, parameters)
    total = len(recording.blocks) + len(recording.edges) + len(recording.references)
    events = with_progress(recording, 'weighing', total, shown=progress)
    signal: Iterator[SampleBlock | EyeEdge] = (
        event for event in events if not isinstance(event, Reference)
    )
    # As replay does at full speed: how a stream is cut changes no mass, and each block is work.
    weighings = line.weigh_all(join(signal, recording.load_cell.sample_rate))
    return join_all(weighings, recording.edges, recording.references)
