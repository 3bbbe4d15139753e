"""Weighing recordings without the graph."""

from checkweigher_dsp.pipeline.line import LineParameters, WeighingLine
from checkweigher_recording.block_cutting import join_recording
from checkweigher_recording.progress import with_progress
from checkweigher_recording.recording import Recording
from checkweigher_validation.accuracy.results import ItemResult, join_all


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
        Whether to show a bar on a terminal if it takes more than a second.

    Returns
    -------
    list of ItemResult
        In order of entry.
    """
    line = WeighingLine(recording.load_cell, parameters)
    # As replay does at full speed: how a stream is cut changes no mass, and each block is work.
    signal = join_recording(recording)
    events = with_progress(signal, 'weighing', len(signal), shown=progress)
    return join_all(line.weigh_all(events), recording.edges, recording.references)
