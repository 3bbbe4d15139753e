"""Writing a recording as a ROS 2 bag: MCAP, with check sums, the same bytes for the same events."""

from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
import os
from pathlib import Path
import shutil
from types import TracebackType
from typing import Any, Self

from mcap.writer import CompressionType, Writer
import numpy as np
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2.metadata import dump_qos_v9
import yaml

from checkweigher_driver.bag_messages import (
    HEADER,
    LOAD_CELL_INFO,
    PHOTO_EYES,
    REFERENCE_MASS,
    SAMPLES,
    TIME,
    TOPICS,
    Topic,
    typestore,
)
from checkweigher_driver.recording import Event
from checkweigher_dsp.records import NANOSECONDS, EyeEdge, LoadCell, SampleBlock

# Fixed, not taken from the folder: a recording has the same bytes wherever it is written.
_FILE = 'line_0.mcap'
_VERSION = 9  # of the bag format
_QUEUE_DEPTH = 1000  # of the topics that are not latched
_FOREVER = QosTime(9223372036, 854775807)


class OutputError(ValueError):
    """An output that cannot be written; one line that says which and why."""


class BagWriter:
    """Writes the events of one lane into a new bag.

    A context manager. The bag appears under its name when the block ends without an exception;
    until then, and after an exception, there is nothing under this name. The log time of a
    message is the stamp of its event. Equal events give equal bytes in all files of the bag.

    Parameters
    ----------
    path : Path
        Folder to make; its parent must exist.
    load_cell : LoadCell
        The cell that took the samples.
    namespace : str
        Of the lane, ``''`` for none.

    Raises
    ------
    OutputError
        If there is something at `path` already, or it cannot be written.
    BagError
        If the message definitions are not installed.

    Notes
    -----
    The file has check sums of each chunk, of the data section and of the summary, so any damage
    shows. That is why it is written by the mcap package: rosbags leaves the check sums out.
    """

    def __init__(self, path: Path, load_cell: LoadCell, namespace: str = '') -> None:
        check_output(path)
        self._path = path
        self._partial = path.with_name(f'.{path.name}.{os.getpid()}.partial')
        self._prefix = ''.join(f'/{part}' for part in namespace.split('/') if part)
        self._encoder = _Encoder(load_cell)
        self._counts: Counter[Topic] = Counter()
        self._begin = self._end = 0

    def __enter__(self) -> Self:
        """Begin the bag."""
        try:
            self._partial.mkdir()
            self._file = (self._partial / _FILE).open('xb')
        except OSError as error:
            shutil.rmtree(self._partial, ignore_errors=True)
            raise _output_error(self._path, error) from None
        # The check sum of the data section is off by default.
        self._mcap = Writer(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)
        self._mcap.start(profile='ros2')
        self._channels = {topic: self._add_channel(topic) for topic in TOPICS}
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Complete the bag, or remove what has been written of it."""
        try:
            if error is None:
                self._complete()
        except OSError as failure:
            raise _output_error(self._path, failure) from None
        finally:
            with suppress(OSError):
                self._file.close()
            shutil.rmtree(self._partial, ignore_errors=True)

    def write(self, event: Event) -> None:
        """Append an event; the stamp of the first one is also that of the load cell's message.

        Raises
        ------
        OutputError
            If it cannot be written, because the disk is full for instance.
        """
        try:
            if not self._counts:
                self._begin = self._end = event.stamp
                self._put(LOAD_CELL_INFO, event.stamp, self._encoder.describe(event.stamp))
            self._put(*self._encoder.encode(event))
        except OSError as error:
            raise _output_error(self._path, error) from None

    def _put(self, topic: Topic, stamp: int, data: bytes) -> None:
        self._mcap.add_message(self._channels[topic], stamp, data, publish_time=stamp)
        self._counts[topic] += 1
        self._begin, self._end = min(self._begin, stamp), max(self._end, stamp)

    def _add_channel(self, topic: Topic) -> int:
        """Return the number of a new channel for a topic."""
        text, _ = typestore().generate_msgdef(topic.message_type, ros_version=2)
        schema = self._mcap.register_schema(topic.message_type, 'ros2msg', text.encode())
        qos = yaml.safe_dump(dump_qos_v9([_qos(topic)]), sort_keys=False).strip()
        digest = typestore().hash_rihs01(topic.message_type)
        return self._mcap.register_channel(
            f'{self._prefix}/{topic.name}',
            'cdr',
            schema,
            {'offered_qos_profiles': qos, 'topic_type_hash': digest},
        )

    def _complete(self) -> None:
        if not self._counts:
            raise OutputError(f'{self._path}: there is nothing to write')
        information = self._information()
        text = yaml.safe_dump(information, sort_keys=False)
        self._mcap.add_metadata('rosbag2', {'serialized_metadata': text})
        self._mcap.finish()
        self._file.close()
        text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
        (self._partial / 'metadata.yaml').write_text(text, encoding='utf-8')
        self._partial.rename(self._path)

    def _information(self) -> dict[str, Any]:
        """Return what metadata.yaml says."""
        topics = [
            {
                'topic_metadata': {
                    'name': f'{self._prefix}/{topic.name}',
                    'type': topic.message_type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': dump_qos_v9([_qos(topic)]),
                    'type_description_hash': typestore().hash_rihs01(topic.message_type),
                },
                'message_count': self._counts[topic],
            }
            for topic in TOPICS
        ]
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **self._span(),
            'topics_with_message_count': topics,
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [_FILE],
            'files': [{'path': _FILE, **self._span()}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }

    def _span(self) -> dict[str, Any]:
        return {
            'duration': {'nanoseconds': self._end - self._begin},
            'starting_time': {'nanoseconds_since_epoch': self._begin},
            'message_count': self._counts.total(),
        }


def write_bag(
    path: Path, load_cell: LoadCell, events: Iterable[Event], namespace: str = ''
) -> None:
    """Write the events of one lane as a new bag, all or nothing.

    Parameters
    ----------
    path : Path
        Folder to make; its parent must exist.
    load_cell : LoadCell
        The cell that took the samples.
    events : iterable of SampleBlock, EyeEdge or Reference
        In canonical order; they are not kept.
    namespace : str
        Of the lane, ``''`` for none.

    Raises
    ------
    OutputError
        If there is something at `path` already, or it cannot be written.
    BagError
        If the message definitions are not installed.
    """
    with BagWriter(path, load_cell, namespace) as bag:
        for event in events:
            bag.write(event)


def check_output(path: Path) -> None:
    """Check that a file or folder can be made, before the work for it begins.

    Parameters
    ----------
    path : Path
        The new file or folder.

    Raises
    ------
    OutputError
        If `path` exists or its parent is not a folder that can be written to.
    """
    if os.path.lexists(path):
        raise OutputError(f'{path}: exists already; remove it or choose another name')
    if not path.parent.is_dir():
        raise OutputError(f'{path}: there is no folder {path.parent}; make it first')
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise OutputError(f'{path}: folder {path.parent} is read-only')


def _output_error(path: Path, error: OSError) -> OutputError:
    return OutputError(f'{path}: cannot be written: {error.strerror or error}')


def _qos(topic: Topic) -> Qos:
    return Qos(
        QosHistory.KEEP_LAST,
        1 if topic.latched else _QUEUE_DEPTH,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if topic.latched else QosDurability.VOLATILE,
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        avoid_ros_namespace_conventions=False,
    )


class _Encoder:
    """Makes messages of records."""

    def __init__(self, load_cell: LoadCell) -> None:
        self._load_cell = load_cell
        self._store = typestore()
        self._time, self._header = self._store.types[TIME], self._store.types[HEADER]

    def describe(self, stamp: int) -> bytes:
        """Return the load cell's message."""
        cell = self._load_cell
        return self._serialize(
            LOAD_CELL_INFO,
            stamp,
            model=cell.model,
            serial_number=cell.serial_number,
            sample_rate=cell.sample_rate,
            counts_per_kg=cell.counts_per_kg,
            zero_counts=cell.zero_counts,
            min_counts=cell.min_counts,
            max_counts=cell.max_counts,
            capacity=cell.capacity,
            weigh_length=cell.weigh_length,
        )

    def encode(self, event: Event) -> tuple[Topic, int, bytes]:
        """Return an event's topic, log time and message."""
        topic, content = _content(event)
        return topic, event.stamp, self._serialize(topic, event.stamp, **content)

    def _serialize(self, topic: Topic, stamp: int, **content: Any) -> bytes:
        second, nanosecond = divmod(stamp, NANOSECONDS)
        header = self._header(self._time(second, nanosecond), '')
        message = self._store.types[topic.message_type](header=header, **content)
        return bytes(self._store.serialize_cdr(message, topic.message_type, little_endian=True))


def _content(event: Event) -> tuple[Topic, dict[str, Any]]:
    if isinstance(event, SampleBlock):
        counts = np.ascontiguousarray(event.counts, '<i4')
        return SAMPLES, {'first_index': event.first_index, 'counts': counts}
    if isinstance(event, EyeEdge):
        return PHOTO_EYES, {'eye': int(event.eye), 'blocked': event.blocked}
    return REFERENCE_MASS, {'mass': event.mass}
