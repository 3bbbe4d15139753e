"""Weigh a bag offline: the stages in one loop, no ROS graph."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import Future

    from checkweigher_dsp.pipeline.side_processes import SideProcesses
    from checkweigher_recording.recording import Recording


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `weigh`."""
    parser.add_argument('bag', type=Path, metavar='BAG', help='folder of a bag, or an .mcap file')
    parser.add_argument('--params', type=Path, metavar='FILE', help='ROS parameter file (YAML)')
    parser.add_argument(
        '--estimator', metavar='NAME', help='method that makes the mass; default iswd_eksi'
    )
    parser.add_argument(
        '--lane', metavar='NAME', help='namespace to weigh, if the bag holds several'
    )
    parser.add_argument('--csv', type=Path, metavar='FILE', help='write one row an item to FILE')
    parser.add_argument('--overwrite', action='store_true', help='replace FILE if it exists')


def run(arguments: argparse.Namespace) -> int:
    """Weigh the bag and show each item."""
    from checkweigher_dsp.pipeline.side_processes import SideProcesses, spare_cores

    # They start while this process is still at its own imports, and one of them reads the bag.
    count = spare_cores() if _size(arguments.bag) >= _LONG else 0
    with SideProcesses(count, ahead=2) as processes:
        reading = _begin_reading(arguments, processes) if count else None
        from checkweigher_bringup.output import CsvOutput, Table, warn_unfinished
        from checkweigher_bringup.settings import line_parameters
        from checkweigher_validation.accuracy.offline import weigh

        parameters = line_parameters(arguments.params, arguments.estimator, arguments.lane)
        output = CsvOutput(arguments.csv, arguments.overwrite)
        recording = _recording(arguments, reading)
        warn_unfinished(recording)
        results = weigh(recording, parameters, progress=True, processes=processes)
    output.write(results)
    table = Table(recording.blocks[0].stamp)
    table.show_all(results)
    table.close()
    return 0


def _begin_reading(
    arguments: argparse.Namespace, processes: 'SideProcesses'
) -> 'Future[Recording]':
    reading = processes.submit_by_name(
        'checkweigher_recording.bags.reading',
        'read_bag',
        arguments.bag,
        arguments.lane,
        progress=True,
    )
    # Behind the reading, for what they get to do then.
    processes.load('checkweigher_dsp.pipeline.mass_stages')
    return reading


def _recording(arguments: argparse.Namespace, reading: 'Future[Recording] | None') -> 'Recording':
    """Return what another process has read; without one, or if it was killed, read it here."""
    if reading is not None:
        from concurrent.futures import BrokenExecutor
        from contextlib import suppress

        with suppress(BrokenExecutor):
            return reading.result()
    from checkweigher_recording.bags.reading import read_bag

    return read_bag(arguments.bag, arguments.lane, progress=True)


# Bytes; of less than a few minutes of signal one process is done before another one has begun.
_LONG = 2 << 20


def _size(bag: Path) -> int:
    """Return the size of the files of a bag, 0 if there is none: reading it says so."""
    try:
        files = list(bag.iterdir()) if bag.is_dir() else [bag]
        return sum(file.stat().st_size for file in files)
    except OSError:
        return 0
