# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of the web server on slow requests, log lines, and pages without a socket."""

import asyncio
import logging
from pathlib import Path
import traceback

from nicegui import Client
from rclpy.logging import get_logger
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from checkweigher_core.printable import one_line

REQUEST = 10.0  # maximum time in s to receive a complete request
WAITING = 100  # maximum number of pages whose browsers have not opened a socket
_PLACES = 3  # number of innermost stack frames that are logged for an error


class PromptProtocol(HttpToolsProtocol):
    """Connection that is closed if a request is not complete within `REQUEST` seconds.

    uvicorn has no such limit, so incomplete requests could use up all connections.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Start the time limit for the first request."""
        super().connection_made(transport)
        self._late = self.loop.call_later(REQUEST, transport.close)

    def on_message_begin(self) -> None:
        """Restart the time limit when the first bytes of a request arrive."""
        super().on_message_begin()
        self._late.cancel()
        self._late = self.loop.call_later(REQUEST, self.transport.close)

    def on_message_complete(self) -> None:
        """Cancel the time limit when a request is complete."""
        super().on_message_complete()
        self._late.cancel()


class LineHandler(logging.Handler):
    """Log handler that writes a record as one line, and then drops all records for 1 s.

    Without this handler, malformed input could fill the log, because the server libraries log it
    with its line ends and with tracebacks.
    """

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._log = get_logger('page')

    def emit(self, record: logging.LogRecord) -> None:
        """Write a log record as one line, unless the previous line is less than 1 s old.

        The line for an exception contains its type, its message, and its innermost stack frames.
        """
        text = record.getMessage()
        if record.exc_info and (error := record.exc_info[1]):
            frames = traceback.extract_tb(error.__traceback__)[: -_PLACES - 1 : -1]
            places = (f'{Path(each.filename).name}:{each.lineno}' for each in frames)
            text = f'{type(error).__name__}: {error} ({" < ".join(places)})'
        self._log.warning(one_line(f'{record.name}: {text}'), throttle_duration_sec=1.0)


def log_in_lines() -> None:
    """Send the warnings and errors of all server libraries to a `LineHandler`."""
    # The handlers of Engine.IO and Socket.IO would write each record a second time.
    for name in ('engineio.server', 'socketio.server'):
        logging.getLogger(name).handlers.clear()
    logging.basicConfig(handlers=[LineHandler()], force=True)


def forget_waiting() -> None:
    """Delete the pages whose browsers have not opened a socket, except the latest `WAITING` pages.

    A page without a socket takes 0.3 MiB of memory for a minute, so many requests could otherwise
    exhaust the memory. A browser that opens the socket of a deleted page loads the page again.
    """
    waiting = [client for client in Client.instances.values() if client.environ is None]
    for client in waiting[:-WAITING]:
        client.delete()
