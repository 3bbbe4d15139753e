# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Samples for a calibration, from a running line or directly from a source."""

from collections.abc import Iterator
from contextlib import contextmanager
import queue
import threading
import time

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_core.pacing import Pacer
from checkweigher_core.records import LoadCell, SampleBlock
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_driver.sources import Source

_PATIENCE = 5.0  # time in s without a message after which an error is raised

_Message = LoadCell | SampleBlock | str


class SampleFeed:
    """Queue of sample blocks from another thread.

    `name` is the name of the topic or of the source, which error messages contain. `load_cell` is
    None until `wait_for_load_cell`, `forget` or `blocks` has taken the load cell from the queue.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.load_cell: LoadCell | None = None
        self._messages: queue.Queue[_Message] = queue.Queue()
        self.taken: list[SampleBlock] = []  # blocks that `blocks` has yielded since `forget`

    def put(self, message: _Message) -> None:
        """Add a block, the load cell, or a text that explains why no more samples will arrive.

        Any thread may call this method.
        """
        self._messages.put(message)

    def wait_for_load_cell(self) -> LoadCell:
        """Wait for the load cell, and return it.

        Blocks that arrive before the load cell are discarded. Raises `UserError` if nothing arrives
        for 5 s, or if the source has ended or failed.
        """
        while self.load_cell is None:
            self._take()
        return self.load_cell

    def forget(self) -> None:
        """Discard the blocks in the queue, because the load may have changed since they arrived.

        Raises `UserError` if the source has ended or failed.
        """
        self.taken = []
        while not self._messages.empty():
            self._take()

    def blocks(self) -> Iterator[SampleBlock]:
        """Yield each block when it arrives.

        Raises `UserError` if nothing arrives for 5 s, or if the source has ended or failed.
        """
        while True:
            if (block := self._take()) is not None:
                self.taken.append(block)
                yield block

    def _take(self) -> SampleBlock | None:
        try:
            message = self._messages.get(timeout=_PATIENCE)
        except queue.Empty:
            raise UserError(
                f'no samples within {_PATIENCE:.0f} s from {self.name}; is the line running?'
            ) from None
        if isinstance(message, str):
            raise UserError(f'{self.name}: {message}')
        if isinstance(message, LoadCell):
            self.load_cell = message
            return None
        return message


@contextmanager
def line_feed(namespace: str) -> Iterator[SampleFeed]:
    """Yield a feed with the samples of a running line."""
    with spinning(namespace) as spinner:
        node = PortNode('calibrate')
        feed = SampleFeed(node.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name))
        for port in (ports.LOAD_CELL_INFO, ports.LOAD_CELL_SAMPLES):
            node.subscribe(port, feed.put, qos=port.qos)
        spinner.add(node)
        yield feed


@contextmanager
def source_feed(name: str, source: Source) -> Iterator[SampleFeed]:
    """Yield a feed with the samples of a source, and close the source when the context ends.

    Another thread reads the source. A source that is not a device, such as the simulator, is read
    in real time.
    """
    feed = SampleFeed(f'source {name}')
    feed.put(source.load_cell)
    ending = threading.Event()

    def read() -> None:
        pacer = Pacer(1.0, source.load_cell.sample_rate, time.monotonic())
        try:
            for event in source:
                if source.paced:
                    ending.wait(max(pacer.due(event) - time.monotonic(), 0.0))
                if ending.is_set():
                    return
                if isinstance(event, SampleBlock):
                    feed.put(event)
            feed.put('the source has ended')
        except Exception as error:
            feed.put(str(error))

    thread = threading.Thread(target=read, name='source', daemon=True)
    thread.start()
    try:
        yield feed
    finally:
        ending.set()
        source.close()
        thread.join(timeout=2.0)
