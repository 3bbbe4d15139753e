# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page, served by a process of its own on a free port."""

from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from http.client import HTTPConnection, HTTPResponse
import os
from pathlib import Path
import re
import subprocess

from running import PATIENCE, children, start_command
import yaml


@contextmanager
def served(*options: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Serve the page, and give its process and port; without the users of who runs the tests."""
    environment = {**os.environ, 'XDG_CONFIG_HOME': os.devnull}
    environment.pop('PYTEST_CURRENT_TEST', None)  # with it NiceGUI compresses nothing
    process = start_command('page', '--port', 0, *options, stdout=None, env=environment)
    try:
        line = process.stderr.readline()
        found = re.fullmatch(r'page: https?://127\.0\.0\.1:(\d+)/.*\n', line)
        assert found, line
        process.said = line
        yield process, int(found[1])
    finally:
        process.kill()
        process.wait()


def write_parameters(path: Path, values: Mapping[str, Mapping[str, object]]) -> None:
    """Write parameters by node to a file."""
    sections = {f'/**/{node}': {'ros__parameters': dict(own)} for node, own in values.items()}
    path.write_text(yaml.safe_dump(sections))


@contextmanager
def line_of(
    params: Path, values: Mapping[str, Mapping[str, object]], *options: str
) -> Iterator[subprocess.Popen[str]]:
    """Run a line with parameters by node, written to a file, and give its process."""
    write_parameters(params, values)
    words = 'run', '--params', params, *options
    line = start_command(*words, stdout=subprocess.DEVNULL, stderr=None)
    try:
        yield line
    finally:
        line.terminate()
        line.wait()


def child_of(process: int) -> int:
    """Return the only process that another one has started."""
    (child,) = children(process)
    return child


def get(port: int, path: str = '/', **headers: str) -> HTTPResponse:
    """Return the answer of the page to a request, read to its end."""
    return _get(port, path, headers)[0]


def get_text(port: int, path: str = '/') -> str:
    """Return what the page sends."""
    return _get(port, path, {})[1]


def _get(port: int, path: str, headers: Mapping[str, str]) -> tuple[HTTPResponse, str]:
    with closing(HTTPConnection('127.0.0.1', port, timeout=PATIENCE)) as connection:
        connection.request('GET', path, headers=dict(headers))
        answer = connection.getresponse()
        return answer, answer.read().decode()
