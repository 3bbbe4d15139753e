# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags that differ from those that the project writes, and what is read of them."""

from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree
from typing import Any

from mcap.writer import Writer as McapWriter
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
import yaml

from checkweigher_core.recording import Recording
from checkweigher_core.records import EyeEdge, SampleBlock
from checkweigher_core.ros.ports import PLAYED
from checkweigher_recording.bags.definitions import HEADER, TIME, BagError, typestore
from checkweigher_recording.bags.reading import read_bag


@dataclass
class Message:
    topic: str
    message_type: str
    stamp: int
    content: dict[str, Any] = field(default_factory=dict)


def messages_of(recording: Recording) -> list[Message]:
    """Return every message of a recording, in canonical order; the first is the load cell's."""
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


def write_foreign(
    path: Path,
    messages: list[Message],
    *,
    store: Typestore | None = None,
    plugin: StoragePlugin = StoragePlugin.MCAP,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    """Write messages, in the order given, with rosbags' own writer."""
    store = store or typestore()
    writer = Writer(path, version=9, storage_plugin=plugin)
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
    return path


def write_split(path: Path, messages: list[Message], mode: CompressionMode, parts: int = 3) -> Path:
    """Write messages as `ros2 bag record` does that splits a bag.

    The files are numbered and follow each other, with one ``metadata.yaml``.
    """
    size = -(-len(messages) // parts)
    path.mkdir()
    names, whole = [], write_foreign(path / 'whole', messages, mode=mode)
    for number in range(parts):
        part = messages[number * size : (number + 1) * size]
        folder = write_foreign(path / f'part_{number}', part, mode=mode)
        (file,) = folder.glob('part_*.mcap*')
        ending = file.name.removeprefix(folder.name)
        names.append(f'{path.name}_{number}{ending}')
        file.rename(path / names[-1])
        rmtree(folder)
    content = yaml.safe_load((whole / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information']['relative_file_paths'] = names
    (path / 'metadata.yaml').write_text(yaml.safe_dump(content))
    rmtree(whole)
    return path


def store_with(message_type: str, text: str) -> Typestore:
    """Return definitions with another one of a message type."""
    store = get_typestore(Stores.EMPTY)
    for part in (TIME, HEADER):
        store.fielddefs[part] = typestore().fielddefs[part]
        store.types[part] = typestore().types[part]
    store.register(get_types_from_msg(text, message_type))
    return store


def refused(path: Path, *parts: str, namespace: str | None = None) -> None:
    """Check that a bag is refused with one line that says all parts."""
    with pytest.raises(BagError) as caught:
        read_bag(path, namespace)
    text = str(caught.value)
    assert '\n' not in text
    for part in (str(path), *parts):
        assert part in text


def write_mcap(
    path: Path,
    messages: list[tuple[Message, int]],
    *,
    definitions: bool = True,
    little_endian: bool = True,
    **options: Any,
) -> None:
    """Write messages with their log times, as the mcap package does."""
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


def same(one: Recording, other: Recording) -> bool:
    """Return whether two recordings are equal to the last bit."""
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
