"""Reading a ROS 2 bag into records: MCAP or SQLite, the whole bag or a clear error."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader

from checkweigher_dsp.records import NANOSECONDS
from checkweigher_recording.bags.chunks import read_chunks
from checkweigher_recording.bags.lane_messages import Lane, LaneMessages, choose_lane, decode
from checkweigher_recording.bags.mcap_integrity import check_mcap
from checkweigher_recording.bags.messages import LOAD_CELL_INFO, SAMPLES, BagError
from checkweigher_recording.bags.types import check_type
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts
from checkweigher_recording.progress import with_progress
from checkweigher_recording.recording import Recording, canonical_order


def read_bag(path: Path, namespace: str | None = None, *, progress: bool = False) -> Recording:
    """Read one lane of a bag.

    Parameters
    ----------
    path : Path
        Folder of a bag, or a single ``.mcap`` or ``.db3`` file. A folder without ``metadata.yaml``
        is a recording that broke off: what is there of its ``.mcap`` files is read.
    namespace : str or None
        Of the lane; None if the bag has only one.
    progress : bool
        Whether to show a bar on a terminal if it takes more than two seconds.

    Returns
    -------
    Recording
        The events in canonical order, whatever their order in the bag; `unfinished` if the
        recording broke off.

    Raises
    ------
    BagError
        If the bag is missing, damaged, incomplete or foreign. Of a file that is said to be whole,
        and of one with a hole, no part is read.

    Notes
    -----
    Check sums are checked where the file has them; some writers leave them out. The numbers of
    messages must agree wherever the bag states them.
    """
    with _one_line(path):
        if parts := unfinished_parts(path):
            return _read_unfinished(path, UnfinishedBag(parts), namespace, progress)
        _check_files(path)
        with Reader(path) as reader:
            return _read_lane(path, reader, namespace, progress)


@contextmanager
def _one_line(path: Path) -> Iterator[None]:
    """Turn whatever a parser raises on strange bytes into one line."""
    try:
        yield
    except BagError:
        raise
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error.strerror or error}') from error
    # Damaged bytes can lead a parser anywhere, so no list of its exceptions would be complete.
    except Exception as error:
        text = ' '.join(str(error).split()) or type(error).__name__
        raise BagError(f'{path}: damaged: {text}; record it again or restore it') from error


def _check_files(path: Path) -> None:
    """Check what can be seen without knowing the messages."""
    if not path.exists():
        raise BagError(f'{path}: there is no such file or folder')
    if not path.is_dir():
        if path.suffix not in ('.mcap', '.db3'):
            raise BagError(f'{path}: not a bag: neither a folder nor a .mcap or .db3 file')
        files = [path]
    elif not (path / 'metadata.yaml').exists():
        raise BagError(f'{path}: not a bag: it has neither metadata.yaml nor an .mcap file')
    else:
        files = sorted(path.iterdir())
    for file in files:
        if file.suffix == '.mcap':
            check_mcap(file)


def _read_unfinished(
    path: Path, bag: UnfinishedBag, namespace: str | None, progress: bool
) -> Recording:
    """Read a recording that broke off, up to there."""
    if bag.damage:
        raise BagError(
            f'{path}: damaged: {bag.damage}; restore it, or "checkweigher recover" saves what is '
            'before it'
        )
    if not bag.message_count:
        raise BagError(f'{path}: the recording broke off before anything of it was written')
    recording = _read_lane(path, bag, namespace, progress)
    last = max(recording.blocks, key=lambda block: block.stamp)
    length = len(last.counts) / recording.load_cell.sample_rate
    length += (last.stamp - recording.blocks[0].stamp) / NANOSECONDS
    text = (
        f'{path}: the recording broke off, or is still going on; read up to {length:.1f} s '
        f'({bag.message_count} messages)'
    )
    return replace(recording, unfinished=text)


def _read_lane(
    path: Path, reader: Reader | UnfinishedBag, namespace: str | None, progress: bool
) -> Recording:
    lane = choose_lane(path, reader.connections, namespace)
    for connection, topic in lane:
        check_type(path, connection, topic)
    connections = [connection for connection, _ in lane]
    found: LaneMessages | None = None
    if isinstance(reader, Reader):
        watch = partial(with_progress, doing='reading', unit='chunks', shown=progress)
        found = read_chunks(path, reader, lane, watch)
    if found is None:
        total = sum(connection.msgcount for connection in connections)
        messages = reader.messages(connections)
        found = decode(path, lane, with_progress(messages, 'reading', total, shown=progress))
    if isinstance(reader, Reader):
        _check_numbers(path, reader, found.numbers, lane)
    if not found.cells:
        raise BagError(
            f'{path}: no {LOAD_CELL_INFO.name}, so its counts mean nothing; record that topic, too'
        )
    if any(cell != found.cells[0] for cell in found.cells):
        raise BagError(
            f'{path}: {LOAD_CELL_INFO.name} changes within the bag; record one bag for each '
            'calibration'
        )
    if not found.blocks:
        raise BagError(f'{path}: no samples on {SAMPLES.name}; the driver was not running')
    return Recording(
        found.cells[0],
        found.blocks.in_canonical_order(),
        tuple(sorted(found.edges, key=canonical_order)),
        tuple(sorted(found.references, key=canonical_order)),
    )


def _check_numbers(path: Path, reader: Reader, read: Mapping[str, int], lane: Lane) -> None:
    """Check that all messages have been read that the bag says it holds.

    A folder says so twice, in ``metadata.yaml`` and in its files. Where the two disagree, or where
    a topic has another name in one of them, messages would be passed over silently.
    """
    storage = reader.storage
    stated = _stated_numbers(storage.connections)
    if isinstance(storage, DirectoryReader):
        stored = _stated_numbers(one for part in storage.storages for one in part.connections)
        for name in sorted(stated.keys() | stored.keys()):
            if stated[name] != stored[name]:
                raise BagError(
                    f'{path}: damaged: metadata.yaml says {stated[name]} messages on {name}, the '
                    f'files say {stored[name]}; restore it or run "ros2 bag reindex"'
                )
    for name in {connection.topic for connection, _ in lane}:
        if stated[name] != read[name]:
            raise BagError(
                f'{path}: damaged: {read[name]} of {stated[name]} messages on {name} can be read; '
                'restore it'
            )


def _stated_numbers(connections: Iterable[Connection]) -> Counter[str]:
    numbers: Counter[str] = Counter()
    for connection in connections:
        numbers[connection.topic] += connection.msgcount
    return numbers
