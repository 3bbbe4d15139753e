# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A PLC of the tests: a Modbus TCP server that plays the photo-eyes of a bag at true time.

    python modbus_plc.py --port 5020 --log coils.jsonl [--watchdog 0.5]
        [--bag BAG] [--skip S] [--begin FILE]

Discrete inputs 0 and 1 are infeed and outfeed eye, 2 says that the belt runs. Coil 0 is the
rejector, coil 1 the release of the belt; what is written to them goes to the log, one JSON array
(ns, coil, value) a line. Holding register 0 is the watchdog: when it has not changed for that long,
the PLC puts both coils into their safe state by itself: ejecting, belt not released. Holding
register 1 set to 1 stops the belt. Says `ready NS` when it listens; the bag begins then, less what
of it is skipped; with --begin at the time (ns) that stands in that file, once it is there.
"""

import argparse
import asyncio
from bisect import bisect_right
from collections.abc import Callable
import json
from pathlib import Path
import time
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from checkweigher_recording.bags.reading import read_bag

BLOCKED = {0: 1, 1: 2}
BELT = 4
SAFE = {0: True, 1: False}


class Plc:
    """State of the inputs by time, and what was written to the coils."""

    def __init__(
        self, bag: Path | None, skip: float, begin: Path | None, log: Path, watchdog: float
    ) -> None:
        self._begin_file = begin
        self._watchdog = watchdog
        self._log = log.open('a', buffering=1)
        self._coils: dict[int, bool] = {}
        self._fed = time.monotonic()
        self._stamps, self._states = [0], [0]
        self._begin = self._started = 0
        self._belt_stopped = False
        if bag is not None:
            recording = read_bag(bag)
            self._stamps[0] = begin = recording.blocks[0].stamp
            self._begin = begin + round(skip * 1e9)
            for edge in recording.edges:
                bit = BLOCKED[edge.eye]
                before = self._states[-1]
                self._stamps.append(edge.stamp)
                self._states.append(before | bit if edge.blocked else before & ~bit)

    def start(self) -> int:
        self._started = time.time_ns()
        return self._started

    def inputs(self) -> int:
        if self._begin_file is not None:
            if not self._begin_file.exists():
                return self._states[0]
            self._started, self._begin_file = int(self._begin_file.read_text()), None
        now = time.time_ns() - self._started + self._begin
        return self._states[max(bisect_right(self._stamps, now) - 1, 0)]

    async def act(self, function, start, address, count, registers, values):
        if function == 2:
            registers[0] = self.inputs() | (0 if self._belt_stopped else BELT)
        elif values is None:
            return  # pymodbus reads back what was written
        elif function == 6 and address == 0:
            self._fed = time.monotonic()
        elif function == 6 and address == 1:
            self._belt_stopped = bool(values[0])
        elif function in (5, 15):
            for offset, value in enumerate(values):
                self._note(address + offset, bool(value))

    def _note(self, coil: int, value: bool) -> None:
        if self._coils.get(coil) is not value:
            self._coils[coil] = value
            self._log.write(json.dumps([time.time_ns(), coil, value]) + '\n')

    async def watch(self) -> None:
        while True:
            await asyncio.sleep(0.02)
            if self._coils and time.monotonic() - self._fed > self._watchdog:
                for coil, value in SAFE.items():
                    self._note(coil, value)


def modbus_device(action: Callable[..., Any]) -> SimDevice:
    """Return a device of 16 coils, 16 inputs and 4 registers; `action` sees each access."""
    return SimDevice(
        id=1,
        simdata=(
            [SimData(0, count=16, values=False, datatype=DataType.BITS)],
            [SimData(0, count=16, values=False, datatype=DataType.BITS)],
            [SimData(0, count=4, values=0, datatype=DataType.REGISTERS)],
            [SimData(0, count=1, values=0, datatype=DataType.REGISTERS)],
        ),
        action=action,
    )


async def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument('--port', type=int, required=True)
    parser.add_argument('--log', type=Path, required=True)
    parser.add_argument('--bag', type=Path)
    parser.add_argument('--begin', type=Path)
    parser.add_argument('--skip', type=float, default=0.0)
    parser.add_argument('--watchdog', type=float, default=1e9)
    given = parser.parse_args()
    plc = Plc(given.bag, given.skip, given.begin, given.log, given.watchdog)
    device = modbus_device(plc.act)
    server = ModbusTcpServer(device, address=('127.0.0.1', given.port))
    await server.serve_forever(background=True)
    print('ready', plc.start(), flush=True)
    await plc.watch()


if __name__ == '__main__':
    asyncio.run(main())
