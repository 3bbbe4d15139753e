"""A whole bag of what is there of a recording that broke off."""

from pathlib import Path

from rosbags.interfaces import Connection

from checkweigher_recording.bags.file import BagFile
from checkweigher_recording.bags.messages import INPUT_TOPICS, OUTPUT_TOPICS, BagError, Topic
from checkweigher_recording.bags.types import check_type
from checkweigher_recording.bags.unfinished import UnfinishedBag, unfinished_parts


def recover_bag(source: Path, path: Path) -> int:
    """Write a new bag of all messages up to where a recording was cut; return their number.

    Parameters
    ----------
    source : Path
        An ``.mcap`` file without an end, or the folder of a recording that broke off. Of a chunk
        with a wrong check sum nothing is taken, nor of anything behind it.
    path : Path
        Bag to write.

    Raises
    ------
    BagError
        If there is no message of a checkweigher in it, if they are of several lanes, or if they
        have other definitions than those that are installed here.
    OutputError
        If the bag cannot be written.
    """
    try:
        bag = UnfinishedBag(unfinished_parts(source) or [source])
    except OSError as error:
        raise BagError(f'{source}: cannot be read: {error.strerror or error}') from error
    found: dict[str, tuple[str, Topic]] = {}
    taken: list[Connection] = []
    for connection in bag.connections:
        topic = _topic_of(connection.topic)
        if topic is not None and connection.msgcount:
            check_type(source, connection, topic)
            found[connection.topic] = connection.topic.removesuffix(f'/{topic.name}'), topic
            taken.append(connection)
    # What nodes of all lanes share says nothing of the lane.
    lanes = {prefix for prefix, topic in found.values() if not topic.name.startswith('/')}
    if len(lanes) != 1:
        what = 'holds several lanes' if lanes else 'no message of a checkweigher can be read'
        raise BagError(f'{source}: {what}; there is nothing to recover')
    topics = list(dict.fromkeys(topic for _, topic in found.values()))
    with BagFile(path, topics, lanes.pop()) as whole:
        for connection, time, data in bag.messages(taken):
            whole.put(found[connection.topic][1], time, data)
        return whole.message_count


def _topic_of(name: str) -> Topic | None:
    """Return the topic of a checkweigher that has this name in some lane."""
    topics = [
        topic
        for topic in (*INPUT_TOPICS, *OUTPUT_TOPICS)
        if name == topic.name or name.endswith(f'/{topic.name}')
    ]
    # The longest: load_cell/status is no status of a lane called load_cell.
    return max(topics, key=lambda topic: len(topic.name), default=None)
