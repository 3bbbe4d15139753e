"""What the driver is told: source, photo-eyes, outputs."""

from dataclasses import dataclass
from typing import ClassVar

from checkweigher_driver.line_io import OUTPUTS
from checkweigher_driver.sources import EYES, NO_EYES, SOURCES
from checkweigher_dsp.parameters import Parameters, parameter


@dataclass(frozen=True)
class DriverParameters(Parameters):
    """Where samples and edges come from."""

    node: ClassVar[str] = 'driver'

    source: str = parameter(
        'simulator', 'where samples and edges come from', choices=tuple(SOURCES)
    )
    eyes: str = parameter(
        NO_EYES, 'photo-eyes that are read beside the load cell; none where the source has them',
        choices=tuple(EYES),
    )  # fmt: skip
    rate: float = parameter(
        1.0, 'pace of a recorded or simulated source, seconds of signal in a second; '
        '0 as fast as nothing is lost', minimum=0, maximum=1e6,
    )  # fmt: skip
    lossless: bool = parameter(
        True, 'hold a recorded or simulated source back until the segmenter has taken what was '
        'sent; false runs it without a segmenter',
    )  # fmt: skip
    listeners: int = parameter(
        0, 'nodes beside segmenter, such as recorders, that have to take load_cell/samples before '
        'a recorded or simulated source begins', minimum=0, maximum=1000,
    )  # fmt: skip
    block_time: float = parameter(
        0.1, 'duration to which the blocks of a recorded or simulated source are joined, the '
        'fewer the less work; an edge waits for none; 0 leaves them as they are',
        unit='s', minimum=0, maximum=1,
    )  # fmt: skip
    outputs: str = parameter(
        'none', 'what rejector and stop are connected to', choices=tuple(OUTPUTS)
    )
    autostart: bool = parameter(
        True, 'configure and activate at the start; false leaves that to a lifecycle manager'
    )
