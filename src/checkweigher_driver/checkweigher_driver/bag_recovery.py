"""Saving what is there of a recording whose recorder was killed."""

from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from checkweigher_driver.bag_file import BagFile
from checkweigher_driver.bag_messages import INPUT_TOPICS, OUTPUT_TOPICS, BagError, Topic


def recover_bag(source: Path, path: Path) -> int:
    """Write a new bag of all messages of a file up to where it was cut; return their number.

    Parameters
    ----------
    source : Path
        An ``.mcap`` file without an end. Of a chunk with a wrong check sum nothing is taken, nor
        of anything behind it.
    path : Path
        Bag to write.

    Raises
    ------
    BagError
        If there is no message of a checkweigher in the file, or those of several lanes.
    OutputError
        If the bag cannot be written.
    """
    messages: list[tuple[Channel, Message]] = []
    try:
        messages += _messages(source)
    except OSError as error:
        raise BagError(f'{source}: cannot be read: {error.strerror or error}') from error
    known = {f'/{topic.name}': topic for topic in (*INPUT_TOPICS, *OUTPUT_TOPICS)}
    found: dict[str, tuple[str, Topic]] = {}
    for channel, _ in messages:
        for name, topic in known.items():
            # The longest name: load_cell/status is no status of a lane called load_cell.
            if channel.topic.endswith(name):
                found[channel.topic] = channel.topic[: -len(name)], topic
    lanes = {prefix for prefix, _ in found.values()}
    if len(lanes) != 1:
        what = 'holds several lanes' if lanes else 'no message of a checkweigher can be read'
        raise BagError(f'{source}: {what}; there is nothing to recover')
    topics = list(dict.fromkeys(topic for _, topic in found.values()))
    with BagFile(path, topics, lanes.pop()) as bag:
        for channel, message in messages:
            if channel.topic in found:
                bag.put(found[channel.topic][1], message.log_time, message.data)
        return bag.message_count


def _messages(source: Path) -> Iterator[tuple[Channel, Message]]:
    channels: dict[int, Channel] = {}
    with source.open('rb') as file:
        records = iter(StreamReader(file, validate_crcs=True).records)
        while True:
            try:
                record = next(records, None)
            # A cut can lead the parser anywhere; what came before it is whole by its check sum.
            except Exception:
                return
            if record is None:
                return
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and record.channel_id in channels:
                yield channels[record.channel_id], record
