# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs of a plant that use libraries of other makers.

Each program prints one JSON object per line. A client of OPC UA takes the arguments URL, LANE, the
files of its certificate and key, USER, PASSWORD and COUNT, and prints:

- ``nodes`` and ``needed``: names of the nodes of the lane, and those that its type makes mandatory;
- ``select``: status of SelectProduct with the product ``heavy``; the client ends after that if
  COUNT is 0, and continues with the items if the status is not Good;
- ``alarm`` and ``acknowledged``: reason of the next alarm, and status of its Acknowledge;
- ``unhold``: status of Unhold, after the client has selected the product ``light``;
- ``item``: numbers of COUNT items, including those weighed while the gateway did not run;
- ``gross``: mass of the last item in kg;
- ``refused``: reason why the client could not continue.

A host of Sparkplug takes the arguments PORT, GROUP and NODE. It asks for a rebirth for each line of
its input, and prints ``kind``, ``metrics`` and the names of the ``historical`` metrics of messages.
"""

from collections.abc import Iterator
from contextlib import contextmanager
import json
from pathlib import Path
import shutil
import subprocess
import threading
from typing import Any, NamedTuple

import pytest
from running import ROOT

_HERE = ROOT / 'test/support'


class Folder(NamedTuple):
    """Programs in one language: folder, a file that the build creates, and the build command."""

    name: str
    built: str
    build: tuple[str, ...]

    @property
    def path(self) -> Path:
        """Folder of the programs."""
        return _HERE / self.name

    @property
    def missing(self) -> str:
        """Reason why the programs cannot be built, or an empty text."""
        return '' if shutil.which(self.build[0]) else f'there is no {self.build[0]}'

    @property
    def is_built(self) -> bool:
        """Whether the programs can be run."""
        return (self.path / self.built).exists()

    def make(self) -> None:
        """Build the programs with the pinned versions of the libraries."""
        subprocess.run(self.build, cwd=self.path, check=True)


_NODE = Folder('plant_node', 'node_modules/node-opcua-client', ('npm', 'ci', '--silent'))
_JAVA = Folder('plant_java', 'target/classpath', ('mvn', '-q', '-B', 'compile'))
_RUST = Folder('plant_rust', 'target/release/opcua', ('cargo', 'build', '--release', '--locked'))


class Program(NamedTuple):
    """Program of a plant, with the name of its library."""

    library: str
    folder: Folder
    name: str

    def words(self) -> list[str]:
        """Return the command that runs the program."""
        folder = self.folder.path
        if self.folder is _NODE:
            return ['node', str(folder / self.name)]
        if self.folder is _JAVA:
            path = (folder / 'target/classpath').read_text()
            return ['java', '-cp', f'{folder}:{folder}/target/classes:{path}', self.name]
        return [str(folder / 'target/release' / self.name)]


CLIENTS = (
    Program('node-opcua-client', _NODE, 'opcua_client.js'),
    Program('Eclipse Milo', _JAVA, 'OpcuaClient'),
    Program('async-opcua', _RUST, 'opcua'),
)
HOSTS = (
    Program('Eclipse Tahu', _JAVA, 'SparkplugHost'),
    Program('srad', _RUST, 'sparkplug'),
)


class Running:
    """Running program, with the objects that it has printed."""

    def __init__(self, program: Program, *arguments: object) -> None:
        self.said: list[dict[str, Any]] = []
        self.process = subprocess.Popen(
            [*program.words(), *map(str, arguments)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith('{'):
                self.said.append(json.loads(line))

    def all(self, word: str) -> list[Any]:
        """Return all values that the program has printed for a key."""
        return [each[word] for each in list(self.said) if word in each]

    def ended(self, timeout: float) -> int:
        """Wait until the program ends, and return its exit status."""
        status = self.process.wait(timeout)
        self._reader.join(timeout)
        return status

    def write_line(self) -> None:
        """Write an empty line to the input of the program."""
        assert self.process.stdin is not None
        self.process.stdin.write('\n')
        self.process.stdin.flush()


@contextmanager
def running(program: Program, *arguments: object) -> Iterator[Running]:
    """Run a program, and kill it at the end."""
    made = Running(program, *arguments)
    try:
        yield made
    finally:
        made.process.kill()
        made.process.wait()
        assert made.process.stdin is not None
        made.process.stdin.close()


def build(program: Program) -> None:
    """Build a program, or skip the test."""
    if program.folder.missing:
        pytest.skip(program.folder.missing)
    program.folder.make()
