# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writer of ROS 2 bags in MCAP with check sums."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
import glob
import os
from pathlib import Path
import shutil
from typing import Any

from mcap.writer import CompressionType, Writer
from rosbags import interfaces
from rosbags.rosbag2.metadata import dump_qos_v9
import yaml

from checkweigher_core.recording import Event
from checkweigher_core.records import LoadCell
from checkweigher_core.ros.ports import LOAD_CELL_INFO, PLAYED, Port
from checkweigher_core.whole_file import OutputError, check_new, output_error, write_whole
from checkweigher_recording.bags.definitions import serialize, typestore
from checkweigher_recording.bags.lanes import lane_prefix

# Name of the file in the folder of a bag. The name of the file does not depend on the name of the
# folder, because equal recordings must have equal bytes.
_FILE = 'line_0.mcap'
_VERSION = 9  # version of the bag format
_FOREVER = interfaces.QosTime(9223372036, 854775807)
_PORTS = {port.record: port for port in PLAYED}


def write_bag(
    path: Path, load_cell: LoadCell, events: Iterable[Event], namespace: str = ''
) -> None:
    """Write the events of one lane to a new bag. If an error occurs, no bag is left behind.

    The log time of a message is the stamp of its event. The first message describes the load cell,
    and has the stamp of the first event. Calls with equal arguments write equal bytes, even if
    `path` differs.

    Parameters
    ----------
    path : Path
        New folder; its parent must exist.
    load_cell : LoadCell
        Load cell of the samples.
    events : iterable of SampleBlock, EyeEdge or Reference
        Events in canonical order. They are not kept in memory.
    namespace : str
        Namespace of the topics of the lane. It may be empty.

    Raises
    ------
    OutputError
        If `path` exists already or cannot be written, or if there are no events.
    BagError
        If the message definitions are not installed.
    """
    with BagWriter(path, PLAYED, namespace) as bag:
        for event in events:
            if bag.message_count == 0:
                bag.put_record(LOAD_CELL_INFO, event.stamp, load_cell)
            bag.put_record(_PORTS[type(event)], event.stamp, event)


class BagWriter(AbstractContextManager['BagWriter', None]):
    """Context manager that writes serialized messages to a new bag.

    `ports` are the topics of the bag. By default, the folder of the bag appears when the context
    ends; if an exception ends the context, no folder appears. If `in_place` is True, the folder
    appears with the first message, and ``metadata.yaml`` is added when the context ends. With
    `in_place`, an exception leaves the messages without ``metadata.yaml``, and a killed process
    leaves at least the messages before the latest call of `flush`. Equal messages with equal calls
    of `flush` give equal bytes. `path` and `namespace` are as in `write_bag`.

    Raises `OutputError` if `path` exists already or cannot be written, or if the context ends
    without an exception before a message was added.

    Notes
    -----
    The file contains check sums of each chunk, of the data section and of the summary, so that
    damage is detected. The mcap package is used because rosbags does not write check sums.
    """

    def __init__(
        self, path: Path, ports: Sequence[Port], namespace: str = '', *, in_place: bool = False
    ) -> None:
        check_new(path)
        self._path = path
        self._in_place = in_place
        self._folder = path if in_place else path.with_name(f'.{path.name}.{os.getpid()}.partial')
        self._mcap: Writer | None = None
        self._ports = ports
        self._prefix = lane_prefix(namespace)
        self._channels: dict[str, int] = {}
        self._counts: Counter[str] = Counter()
        self._begin = self._end = 0

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """Complete the bag, or discard it after an exception.

        If `in_place` is True, an incomplete bag with the messages is left after an exception.
        Raises `OutputError` if there are no messages, or the bag cannot be written.
        """
        try:
            if error is None:
                with self._writing():
                    self._complete()
            elif self._in_place and self._mcap is not None:
                with suppress(OSError):
                    self._mcap.flush()
        finally:
            if self._mcap is not None:
                with suppress(OSError):
                    self._file.close()
            if not self._in_place:
                shutil.rmtree(self._folder, ignore_errors=True)

    @property
    def message_count(self) -> int:
        """Number of messages written so far."""
        return self._counts.total()

    def put(self, port: Port, stamp: int, data: bytes) -> None:
        """Append a CDR message to the topic `port`, with the log time `stamp` in ns.

        `port` must be one of the `ports` of the bag. Raises `OutputError` if the message cannot be
        written, for example because the disk is full. The first call raises `BagError` if the
        definition of a message type is not installed.
        """
        mcap = self._mcap or self._open()
        with self._writing():
            mcap.add_message(self._channels[port.name], stamp, data, publish_time=stamp)
        if not self._counts:
            self._begin = self._end = stamp
        self._counts[port.name] += 1
        self._begin, self._end = min(self._begin, stamp), max(self._end, stamp)

    def put_record(self, port: Port, stamp: int, record: object) -> None:
        """Append a record to the topic `port`, with the log time `stamp` in ns.

        If the record has no time stamp, its message has the time `stamp`, too. The exceptions are
        as in `put`.
        """
        self.put(port, stamp, serialize(port, record, stamp))

    def flush(self) -> None:
        """Write all buffered messages to the file, where they remain if the process is killed.

        Raises `OutputError` if the messages cannot be written.
        """
        if self._mcap is not None:
            with self._writing():
                self._mcap.flush()

    def _open(self) -> Writer:
        _remove_partial(self._path)
        try:
            self._folder.mkdir()
        except OSError as error:
            raise output_error(self._path, error) from None
        try:
            self._file = (self._folder / _FILE).open('xb')
            # Enable the check sum of the data section, which the writer omits by default.
            mcap = Writer(self._file, compression=CompressionType.ZSTD, enable_data_crcs=True)
            # Set a fixed library name, because the default contains the library version, so that
            # equal recordings would have different bytes after an update.
            mcap.start(profile='ros2', library='checkweigher')
            self._file.flush()
        except OSError as error:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise output_error(self._path, error) from None
        self._mcap = mcap
        self._channels = {port.name: self._add_channel(mcap, port) for port in self._ports}
        return mcap

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            text = str(output_error(self._path, error))
            if self._in_place and self._folder.exists():
                text += '; the earlier messages are kept'
            raise OutputError(text) from None

    def _topic(self, port: Port) -> str:
        return port.name if port.name.startswith('/') else f'{self._prefix}/{port.name}'

    def _add_channel(self, mcap: Writer, port: Port) -> int:
        store = typestore([port])
        text, _ = store.generate_msgdef(port.message_type, ros_version=2)
        schema = mcap.register_schema(port.message_type, 'ros2msg', text.encode())
        qos = yaml.safe_dump(dump_qos_v9([_qos(port)]), sort_keys=False).strip()
        digest = store.hash_rihs01(port.message_type)
        metadata = {'offered_qos_profiles': qos, 'topic_type_hash': digest}
        return mcap.register_channel(self._topic(port), 'cdr', schema, metadata)

    def _complete(self) -> None:
        if self._mcap is None or not self._counts:
            raise OutputError(f'{self._path}: there is nothing to write')
        information = self._information()
        text = yaml.safe_dump(information, sort_keys=False)
        self._mcap.add_metadata('rosbag2', {'serialized_metadata': text})
        self._mcap.finish()
        self._file.close()
        text = yaml.safe_dump({'rosbag2_bagfile_information': information}, sort_keys=False)
        # The file metadata.yaml is written last, because readers regard a bag with it as complete.
        write_whole(self._folder / 'metadata.yaml', text)
        if not self._in_place:
            self._folder.rename(self._path)

    def _information(self) -> dict[str, Any]:
        return {
            'version': _VERSION,
            'storage_identifier': 'mcap',
            **self._span(),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': self._topic(port),
                        'type': port.message_type,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': dump_qos_v9([_qos(port)]),
                        'type_description_hash': typestore([port]).hash_rihs01(port.message_type),
                    },
                    'message_count': self._counts[port.name],
                }
                for port in self._ports
            ],
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


def _remove_partial(path: Path) -> None:
    """Remove incomplete folders of the bag `path` whose processes have ended."""
    for folder in path.parent.glob(f'.{glob.escape(path.name)}.*.partial'):
        number = folder.suffixes[-2].lstrip('.')
        if number.isdecimal() and not Path(f'/proc/{number}').exists():
            shutil.rmtree(folder, ignore_errors=True)


def _qos(port: Port) -> interfaces.Qos:
    durability = interfaces.QosDurability
    return interfaces.Qos(
        history=interfaces.QosHistory.KEEP_LAST,
        depth=port.history.depth,
        reliability=interfaces.QosReliability.RELIABLE,
        durability=durability.TRANSIENT_LOCAL if port.history.latched else durability.VOLATILE,
        deadline=_FOREVER,
        lifespan=_FOREVER,
        liveliness=interfaces.QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_FOREVER,
        avoid_ros_namespace_conventions=False,
    )
