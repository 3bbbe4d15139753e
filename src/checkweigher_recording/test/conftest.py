# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A small recording, and a writer of bags that differ from those that the project writes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.writer import Writer as McapWriter
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from checkweigher_core.recording import Recording
from checkweigher_core.records import EyeEdge, SampleBlock
from checkweigher_core.ros.ports import PLAYED
from checkweigher_recording.bags.definitions import HEADER, TIME, BagError, typestore
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


@dataclass
class Message:
    topic: str
    message_type: str
    stamp: int
    content: dict[str, Any] = field(default_factory=dict)


@pytest.fixture(scope='session')
def recording() -> Recording:
    return simulate(SimulationParameters(count=2, lead_in=0.2, run_out=0.1))


@pytest.fixture
def messages(recording: Recording) -> list[Message]:
    """Every message of the recording, in canonical order; the first one is the load cell's."""
    return _messages_of(recording)


@pytest.fixture
def messages_of() -> Callable[[Recording], list[Message]]:
    """Return a function that returns the same of any recording."""
    return _messages_of


def _messages_of(recording: Recording) -> list[Message]:
    info, samples, eyes, references = ((f'/{port.name}', port.message_type) for port in PLAYED)
    cell = recording.load_cell
    fields = {name: getattr(cell, name) for name in cell.__slots__}
    listed = [Message(*info, recording.blocks[0].stamp, fields)]
    for event in recording:
        if isinstance(event, SampleBlock):
            content = {'first_index': event.first_index, 'counts': event.counts}
            listed.append(Message(*samples, event.stamp, content))
        elif isinstance(event, EyeEdge):
            content = {'eye': int(event.eye), 'blocked': event.blocked}
            listed.append(Message(*eyes, event.stamp, content))
        else:
            listed.append(Message(*references, event.stamp, {'mass': event.mass}))
    return listed


@pytest.fixture
def write_foreign(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes messages, in the order given, with rosbags' own writer."""

    def write(
        messages: list[Message],
        *,
        store: Typestore | None = None,
        plugin: StoragePlugin = StoragePlugin.MCAP,
        mode: CompressionMode = CompressionMode.NONE,
        name: str = 'foreign',
    ) -> Path:
        store = store or typestore()
        writer = Writer(tmp_path / name, version=9, storage_plugin=plugin)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            channels: dict[tuple[str, str], Any] = {}
            for message in messages:
                key = message.topic, message.message_type
                if key not in channels:
                    channels[key] = writer.add_connection(*key, typestore=store)
                content = dict(message.content)
                if any(part == 'header' for part, _ in store.fielddefs[message.message_type][1]):
                    time = store.types[TIME](*divmod(message.stamp, 10**9))
                    content['header'] = store.types[HEADER](time, 'belt')
                made = store.types[message.message_type](**content)
                data = store.serialize_cdr(made, message.message_type)
                writer.write(channels[key], message.stamp, data)
        return tmp_path / name

    return write


@pytest.fixture
def store_with() -> Callable[[str, str], Typestore]:
    """Return a function that returns definitions with another one of a message type."""

    def with_definition(message_type: str, text: str) -> Typestore:
        store = get_typestore(Stores.EMPTY)
        for part in (TIME, HEADER):
            store.fielddefs[part] = typestore().fielddefs[part]
            store.types[part] = typestore().types[part]
        store.register(get_types_from_msg(text, message_type))
        return store

    return with_definition


@pytest.fixture
def refused() -> Callable[..., None]:
    """Return a function that checks that a bag is refused with one line that says all parts."""

    def check(path: Path, *parts: str, namespace: str | None = None) -> None:
        with pytest.raises(BagError) as caught:
            read_bag(path, namespace)
        text = str(caught.value)
        assert '\n' not in text
        for part in (str(path), *parts):
            assert part in text

    return check


@pytest.fixture
def write_mcap() -> Callable[..., None]:
    """Return a function that writes messages with their log times, as the mcap package does."""

    def write(
        path: Path,
        messages: list[tuple[Message, int]],
        *,
        definitions: bool = True,
        little_endian: bool = True,
        **options: Any,
    ) -> None:
        store = typestore()
        with path.open('xb') as file:
            writer = McapWriter(file, **options)
            writer.start(profile='ros2')
            channels = {}
            for message, log_time in messages:
                if message.topic not in channels:
                    text, _ = store.generate_msgdef(message.message_type, ros_version=2)
                    schema = writer.register_schema(
                        message.message_type,
                        'ros2msg' if definitions else '',
                        text.encode() if definitions else b'',
                    )
                    channels[message.topic] = writer.register_channel(message.topic, 'cdr', schema)
                time = store.types[TIME](*divmod(message.stamp, 10**9))
                header = store.types[HEADER](time, 'a frame')
                made = store.types[message.message_type](header=header, **message.content)
                data = store.serialize_cdr(made, message.message_type, little_endian=little_endian)
                writer.add_message(channels[message.topic], log_time, bytes(data), log_time)
            writer.finish()

    return write


@pytest.fixture
def same() -> Callable[[Recording, Recording], bool]:
    """Return a function that compares two recordings to the last bit."""

    def compare(one: Recording, other: Recording) -> bool:
        return (
            one.load_cell == other.load_cell
            and one.edges == other.edges
            and one.references == other.references
            and len(one.blocks) == len(other.blocks)
            and all(
                (a.stamp, a.first_index, a.counts.dtype, a.counts.tolist())
                == (b.stamp, b.first_index, b.counts.dtype, b.counts.tolist())
                for a, b in zip(one.blocks, other.blocks, strict=True)
            )
        )

    return compare
