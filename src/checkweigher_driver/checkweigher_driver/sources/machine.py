# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Combination of a load cell and separately connected photo-eyes into one source."""

from collections.abc import Callable, Iterator
import queue
import threading
from typing import Any

from checkweigher_core.recording import Event
from checkweigher_core.records import SampleBlock
from checkweigher_driver.sources import (
    EdgeSource,
    EyesBack,
    EyesLost,
    Source,
    shorten_switch_interval,
)

_END_PATIENCE = 2.0  # longest wait in s for the end of a thread


class MachineSource(Source):
    """Samples of one device and edges of another device, in the order of their arrival.

    Each device is read in its own thread. The stamps of both devices must be on the same clock.
    Blocks of samples are discarded while the photo-eyes cannot be read, so that an item on the belt
    gets the decision FAULT. At least one block is discarded after each loss of the photo-eyes, even
    if the eyes can be read again before this block arrives.
    """

    paced = False

    def __init__(self, samples: Source, eyes: EdgeSource) -> None:
        self._samples = samples
        self._eyes = eyes
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._closed = False
        self._blind = ''  # reason why the photo-eyes cannot be read, empty if they can be read
        self._gap = False  # whether the next block must be discarded because the eyes were lost
        self._withheld = 0
        self.load_cell = samples.load_cell
        self.start_stamp = samples.start_stamp

    def __iter__(self) -> Iterator[Event]:
        """Yield events when they occur, until `close` is called.

        If a device fails, the iterator raises the exception of the device. If the iterator of a
        device ends before `close` is called, RuntimeError is raised. Both devices are closed at the
        end of the iteration.
        """
        shorten_switch_interval()
        threads = [
            threading.Thread(target=self._read, args=(device, name), name=name, daemon=True)
            for name, device in (('samples', self._samples.__iter__), ('eyes', self._eyes.events))
        ]
        for thread in threads:
            thread.start()
        try:
            while (event := self._queue.get()) is not None:
                if isinstance(event, BaseException):
                    raise event
                yield from self._take(event)
        finally:
            self.close()
            for thread in threads:
                thread.join(_END_PATIENCE)

    def _take(self, event: Event | EyesLost | EyesBack) -> Iterator[Event]:
        if isinstance(event, EyesLost):
            self._blind, self._gap = event.text, True
        elif isinstance(event, EyesBack):
            self._blind = ''
        elif not isinstance(event, SampleBlock):
            yield event
        elif self._blind or self._gap:
            self._gap = False
            self._withheld += len(event.counts)
        else:
            yield event
            yield from self._eyes.follow(event)

    def _read(self, device: Callable[[], Iterator[Any]], what: str) -> None:
        try:
            for event in device():
                self._queue.put(event)
        except Exception as error:
            self._queue.put(error)
        else:
            self._queue.put(
                None if self._closed else RuntimeError(f'the source of the {what} has ended')
            )

    def close(self) -> None:
        """Close both devices, and end the iteration."""
        self._closed = True
        self._samples.close()
        self._eyes.close()
        self._queue.put(None)

    @property
    def trouble(self) -> str:
        """Present faults of both devices in one line, or an empty string if there is no fault."""
        return '; '.join(filter(None, (self._samples.trouble, self._blind or self._eyes.trouble)))

    def figures(self) -> dict[str, float]:
        """Return the values of both devices for the diagnostics, by name.

        ``samples withheld without eyes`` is the number of samples that were discarded.
        """
        return {
            **self._samples.figures(),
            **self._eyes.figures(),
            'samples withheld without eyes': self._withheld,
        }
