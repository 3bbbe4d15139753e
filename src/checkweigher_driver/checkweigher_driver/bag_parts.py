"""Reading the chunks of a long bag side by side, in several processes."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import ChunkInfo

from checkweigher_driver.lane_messages import LaneMessages, choose_lane, decode
from checkweigher_dsp.side_processes import SideProcesses

Messages = Iterable[tuple[Connection, int, bytes]]


@dataclass(frozen=True, slots=True)
class Piece:
    """Successive chunks of one file of a bag.

    Attributes
    ----------
    file : int
        Its number.
    begin, end : int
        Number of the first chunk, and one past that of the last.
    share : float
        Of all that is to be read.
    """

    file: int
    begin: int
    end: int
    share: float


Watch = Callable[[Messages, float], Messages]


def read_side_by_side(
    path: Path, reader: Reader, namespace: str | None, processes: SideProcesses, watch: Watch
) -> LaneMessages | None:
    """Return the messages of a lane, read in this process and those beside it.

    Parameters
    ----------
    path : Path
        Of the bag.
    reader : Reader
        Of the same bag, open.
    namespace : str or None
        Of the lane.
    processes : SideProcesses
        Those beside this one.
    watch : callable
        Given messages that are read here and which share of all they are, returns the same
        messages: it shows the progress.

    Returns
    -------
    LaneMessages or None
        Blocks in the order in which `reader` has them. None if the bag has no chunks to share out,
        and if anything is wrong: what that is the plain way tells.
    """
    if reader.compression_mode == 'file':
        return None  # each process would unpack all of it
    sizes = [[chunk.uncompressed_size for chunk in _chunks(file)] for file in _files(reader)]
    if not all(sizes) or sum(map(len, sizes)) <= processes.count:
        return None
    own, *others = _share_out(sizes, processes.count + 1)
    with suppress(Exception):
        calls = [processes.submit(read_pieces, path, namespace, pieces) for pieces in others]
        found = read_pieces(path, namespace, own, watch)
        for call in calls:
            found += call.result()
        return _joined([*own, *(piece for pieces in others for piece in pieces)], found)
    return None


def read_pieces(
    path: Path,
    namespace: str | None,
    pieces: Sequence[Piece],
    watch: Watch = lambda messages, share: messages,
) -> list[LaneMessages]:
    """Return the messages of a lane in each piece of a bag."""
    with Reader(path) as reader:
        lane = choose_lane(path, reader.connections, namespace)
        connections = [connection for connection, _ in lane]
        files = _files(reader)
        chunks = [_chunks(file) for file in files]
        found = []
        for piece in pieces:
            # Not by log times: two pieces would read a chunk that both have a part of, and take
            # messages that a reader of the whole leaves out, as they are not where they should be.
            files[piece.file].chunks = chunks[piece.file][piece.begin : piece.end]
            if isinstance(reader.storage, DirectoryReader):
                reader.storage.storages = [files[piece.file]]
            found.append(decode(path, lane, watch(reader.messages(connections), piece.share)))
        return found


def _files(reader: Reader) -> list[Any]:
    """Return the readers of the files of a bag."""
    storage = reader.storage
    return list(storage.storages) if isinstance(storage, DirectoryReader) else [storage]


def _chunks(file: Any) -> list[ChunkInfo]:
    """Return the chunks of a file in their order; none if it has no index, or is not MCAP."""
    return sorted(getattr(file, 'chunks', ()), key=attrgetter('chunk_start_offset'))


def _share_out(sizes: Sequence[Sequence[int]], count: int) -> list[list[Piece]]:
    """Return pieces of files, whose chunks have these sizes, for each of `count` processes."""
    total = max(sum(map(sum, sizes)), 1)
    parts: list[list[Piece]] = [[] for _ in range(count)]
    before = 0
    for file, of_file in enumerate(sizes):
        begin = 0
        while begin < len(of_file):
            part = min(count * before // total, count - 1)
            end, first = begin, before
            while end < len(of_file) and (end == begin or count * before // total == part):
                before += of_file[end]
                end += 1
            parts[part].append(Piece(file, begin, end, (before - first) / total))
            begin = end
    return parts


def _joined(pieces: Sequence[Piece], found: Sequence[LaneMessages]) -> LaneMessages:
    """Return what was found in pieces: files one after the other, in each by log time."""
    files: dict[int, list[LaneMessages]] = {}
    for piece, messages in zip(pieces, found, strict=True):
        files.setdefault(piece.file, []).append(messages)
    return LaneMessages.concatenate(
        [LaneMessages.concatenate(parts).by_log_time() for parts in files.values()]
    )
