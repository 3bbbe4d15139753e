"""Reading the chunks of a bag, many messages at once."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from operator import attrgetter
from pathlib import Path
from typing import Any

from rosbags.rosbag2 import Reader
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import ChunkInfo

from checkweigher_recording.bags.lane_messages import Lane, LaneDecoder, LaneMessages
from checkweigher_recording.bags.mcap_chunks import messages_of_chunk
from checkweigher_recording.bags.messages import BagError

Watch = Callable[[Sequence[ChunkInfo]], Iterable[ChunkInfo]]


def read_chunks(path: Path, reader: Reader, lane: Lane, watch: Watch = iter) -> LaneMessages | None:
    """Return the messages of a lane.

    Parameters
    ----------
    path : Path
        Of the bag.
    reader : Reader
        Of the same bag, open.
    lane : list of (Connection, Topic)
        The lane.
    watch : callable
        Given the chunks of a file, returns the same: it shows the progress.

    Returns
    -------
    LaneMessages or None
        Blocks in the order in which `reader` has them. None if the bag has no chunks with an
        index, and if anything is wrong: what that is the plain way tells.
    """
    if reader.compression_mode in ('file', 'message'):
        return None
    with suppress(Exception):
        return LaneMessages.concatenate([
            _read_file(path, file, lane, watch).by_log_time() for file in _files(reader)
        ])  # fmt: skip
    return None


def _files(reader: Reader) -> list[Any]:
    """Return the readers of the files of a bag."""
    storage = reader.storage
    return list(storage.storages) if isinstance(storage, DirectoryReader) else [storage]


def _read_file(path: Path, file: Any, lane: Lane, watch: Watch) -> LaneMessages:
    chunks = sorted(file.chunks, key=attrgetter('chunk_start_offset'))
    if not chunks:
        raise BagError(f'{file.path}: there is no index')
    names = _names_of_channels(file, lane)
    decoder = LaneDecoder(path, lane)
    for chunk in watch(chunks):
        for channel, (log_times, messages) in messages_of_chunk(file.bio, chunk, names).items():
            decoder.add(names[channel], log_times.tolist(), messages)
    return decoder.found()


def _names_of_channels(file: Any, lane: Lane) -> dict[int, str]:
    """Return the names of the topics of a lane by the numbers of their channels in a file.

    Raises
    ------
    BagError
        If ``metadata.yaml`` says something else of a topic than the file.
    """
    names = {}
    for stored in file.connections:
        stated = [connection for connection, _ in lane if connection.topic == stored.topic]
        if not stated:
            continue
        if not any(
            connection.msgtype == stored.msgtype
            and connection.ext == stored.ext
            and ('' in (connection.digest, stored.digest) or connection.digest == stored.digest)
            for connection in stated
        ):
            raise BagError(f'{file.path}: {stored.topic} is not what metadata.yaml says')
        names[stored.id] = stored.topic
    return names
