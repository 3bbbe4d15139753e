"""A recorded line as a source."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from checkweigher_driver.sources import Source
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.recording import Event


@dataclass(frozen=True)
class BagParameters(Parameters):
    """Which recording is replayed."""

    node: ClassVar[str] = 'bag'

    path: str = parameter('', 'folder of the bag, or its .mcap file')
    namespace: str = parameter(
        '', 'namespace of the lane, / for none; empty takes the only lane of the bag'
    )


class BagSource(Source):
    """A bag, read as a whole before the first event: a damaged one does not start the line."""

    parameters = BagParameters
    paced = True

    def __init__(self, parameters: BagParameters) -> None:
        if not parameters.path:
            raise ParameterError('bag.path: empty, must name a bag')
        self._recording = read_bag(Path(parameters.path), parameters.namespace or None)
        self.load_cell = self._recording.load_cell
        self.start_stamp = next(iter(self._recording)).stamp

    def __iter__(self) -> Iterator[Event]:
        """Yield the bag's events in canonical order."""
        return iter(self._recording)

    def close(self) -> None:
        """Do nothing: the bag has been read and closed."""
