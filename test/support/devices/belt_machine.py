# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A machine of the tests: belt, load cell on a port, eyes, rejector, and the program of its PLC.

    python belt_machine.py --port 5020 --link PORT --log events.jsonl [--wiring permit]

The PLC is a Modbus TCP server. Discrete inputs 0 and 1 are infeed and outfeed eye, 2 says that the
belt runs. Coil 0 is `reject`, 1 `release`, 2 `permit`; holding register 0 is `heartbeat`. Its
program is the structured text of docs/hardware_io.md, in `Plc.scan`. Products move with the belt
alone, so a belt that stops takes them nowhere; what becomes of each is a line of the log:
[ns, event, product, mass in g]. What comes on the standard input happens at once, and is answered
by `done`:

    feed N M ...  put products of these masses (g) on the belt, one after the other; 0: none more
    clear         a person takes all products off the belt
    mute S        the PLC answers nothing for S seconds, as one that hangs
    late S        each answer takes S seconds
    drop          the PLC closes all connections
    restart S     the PLC is off for S seconds: all outputs are 0
    unplug, replug, silence S, corrupt, lose N, junk N   of the load cell, as in serial_device.py
    products      answers by one JSON line: number, mass, place of the leading edge (m), state
"""

import argparse
import asyncio
from collections import deque
from dataclasses import dataclass
import json
import logging
from pathlib import Path
import random
import sys
import threading
import time

from modbus_plc import modbus_device
import numpy as np
from pymodbus.server import ModbusTcpServer
from serial_device import Device, options

RATE, COUNTS_PER_KG, ZERO = 600.0, 5e5, 100_000
WEIGH_LENGTH, REJECTOR = 0.2, 0.7  # m, places of outfeed eye and rejector behind the infeed eye
LENGTH = 0.1  # m, of a product
COAST = 0.1  # s, for which the belt runs on
REJECT, RELEASE, PERMIT = 0, 1, 2


@dataclass
class Product:
    number: int
    mass: float  # g
    front: float  # m behind the infeed eye
    ejected: bool = False
    told: bool = False  # that its leading edge has come to the rejector


class Belt:
    """Products on a belt that runs or stands; all places in m behind the infeed eye."""

    def __init__(self, speed: float, spacing: float, log: Path) -> None:
        self.top_speed, self.speed, self.spacing = speed, 0.0, spacing
        self.products: list[Product] = []
        self.to_come: deque[float] = deque()
        self._count = 0
        self._log = log.open('a', buffering=1)

    def note(self, event: str, product: Product | None = None) -> None:
        entry = [time.time_ns(), event, *([product.number, product.mass] if product else [])]
        self._log.write(json.dumps(entry) + '\n')

    def step(self, seconds: float, *, running: bool) -> None:
        change = seconds / COAST * self.top_speed
        wanted = self.top_speed if running else 0.0
        self.speed += max(-change, min(change, wanted - self.speed))
        for product in self.products:
            product.front += self.speed * seconds
        if self.to_come and all(p.front >= self.spacing - 0.1 for p in self.products):
            self._count += 1
            self.products.append(Product(self._count, self.to_come.popleft(), -0.1))

    def blocks(self, place: float) -> bool:
        return any(p.front - LENGTH < place <= p.front for p in self.products)

    def load(self) -> float:
        """Return the load on the weigh belt, g."""
        shares = (
            (min(p.front, WEIGH_LENGTH) - max(p.front - LENGTH, 0.0), p.mass) for p in self.products
        )
        return sum(max(length, 0.0) / LENGTH * mass for length, mass in shares)

    def clear(self) -> None:
        self.products.clear()
        self.note('cleared')


class Plc:
    """The program of the PLC: one scan each few ms."""

    def __init__(self, belt: Belt, wiring: str, watchdog: float) -> None:
        self._belt, self._wiring, self._watchdog = belt, wiring, watchdog
        self.coils = {REJECT: False, RELEASE: False, PERMIT: False}
        self.heartbeat = 0
        self._last_heartbeat, self._fed = 0, 0.0
        self._had_permit = self._granted = False
        self.on = True
        self.runs = False

    def scan(self) -> None:
        now, belt = time.monotonic(), self._belt
        if self.heartbeat != self._last_heartbeat:
            self._last_heartbeat, self._fed = self.heartbeat, now
        alive = self.on and now - self._fed < self._watchdog
        runs = alive and self.coils[RELEASE]
        if runs != self.runs:
            self.runs = runs
            belt.note('run' if runs else ('stop' if alive else 'watchdog'))
        permit = alive and self.coils[PERMIT]
        self._granted = permit and (self._granted or not self._had_permit)
        self._had_permit = permit
        for product in list(belt.products):
            if product.front < REJECTOR:
                continue
            arrives, product.told = not product.told, True
            if self._wiring == 'permit':
                if arrives:  # one permit, one product
                    product.ejected, self._granted = not self._granted, False
            else:
                product.ejected |= self.coils[REJECT] or not alive
            if product.ejected or product.front - LENGTH >= REJECTOR:
                belt.note('ejected' if product.ejected else 'passed', product)
                belt.products.remove(product)


class Machine(Device):
    """Belt and load cell, at the pace of the samples, with the PLC's program beside them."""

    def __init__(self, given: argparse.Namespace) -> None:
        words = (given.link, '--rate', RATE, '--signal', 'slow', '--status', 8)
        super().__init__(options().parse_args([str(word) for word in words]))
        self.belt = Belt(given.speed, given.spacing, given.log)
        self.plc = Plc(self.belt, given.wiring, given.watchdog)
        self.lock = threading.Lock()
        self._samples: deque[int] = deque(maxlen=20_000)
        self._taken = 0
        self._noise = random.Random(1)

    def counts(self, first: int, end: int) -> np.ndarray:
        skip = first - (self._taken - len(self._samples))
        return np.array(list(self._samples)[skip : skip + end - first])

    def advance(self) -> None:
        """Move the belt to where it is now; the lock is held."""
        due = int((time.monotonic() - self.begin) * RATE) + 1
        while self._taken < due:
            self.belt.step(1 / RATE, running=self.plc.runs)
            load = self.belt.load() * 1e-3 * COUNTS_PER_KG
            self._samples.append(round(ZERO + load + self._noise.gauss(0.0, 20.0)))
            self._taken += 1
            self.plc.scan()

    def turn(self) -> None:
        """Send and answer what is due."""
        with self.lock:
            self.advance()
            self.answer()
            self.stream()

    def run(self) -> None:
        while True:
            self.turn()
            time.sleep(0.004)


class Server:
    """The Modbus side of the PLC, with its faults."""

    def __init__(self, machine: Machine, port: int) -> None:
        self._machine, self._port = machine, port
        self._muted_until, self.lateness = 0.0, 0.0
        self._server: ModbusTcpServer | None = None

    async def act(self, function, start, address, count, registers, values):
        while time.monotonic() < self._muted_until:
            await asyncio.sleep(0.01)
        if self.lateness:
            await asyncio.sleep(self.lateness)
        plc, belt = self._machine.plc, self._machine.belt
        with self._machine.lock:
            # Eyes are read as they are now: a turn that comes late on a busy host would part their
            # edges from the samples, whose clock does not run late.
            self._machine.advance()
            if function == 2:
                bits = (belt.blocks(0.0), belt.blocks(WEIGH_LENGTH), plc.runs)
                registers[0] = sum(1 << n for n, bit in enumerate(bits) if bit)
            elif values is None:
                return  # pymodbus reads back what was written
            elif function == 6 and address == 0:
                plc.heartbeat = int(values[0])
            elif function in (5, 15):
                for offset, value in enumerate(values):
                    plc.coils[address + offset] = bool(value)

    def mute(self, seconds: float) -> None:
        self._muted_until = time.monotonic() + seconds

    async def open(self) -> None:
        device = modbus_device(self.act)
        self._server = ModbusTcpServer(device, address=('127.0.0.1', self._port))
        await self._server.serve_forever(background=True)

    async def restart(self, seconds: float, *, power: bool) -> None:
        await self._server.shutdown()
        if power:
            plc = self._machine.plc
            with self._machine.lock:
                plc.on = False
                plc.coils = dict.fromkeys(plc.coils, False)
        await asyncio.sleep(seconds)
        await self.open()
        self._machine.plc.on = True


async def obey(line: str, machine: Machine, server: Server) -> str:
    word, *values = line.split()
    belt = machine.belt
    if word == 'products':
        with machine.lock:
            shown = [(p.number, p.mass, p.front, p.ejected) for p in belt.products]
        return json.dumps({'products': shown, 'to come': len(belt.to_come)})
    if word == 'feed':
        with machine.lock:
            belt.to_come.extend(float(mass) for mass in values)
            if values == ['0']:
                belt.to_come.clear()
    elif word == 'clear':
        with machine.lock:
            belt.clear()
    elif word == 'mute':
        server.mute(float(values[0]))
    elif word == 'late':
        server.lateness = float(values[0])
    elif word in ('drop', 'restart'):
        await server.restart(float(values[0]) if values else 0.0, power=word == 'restart')
    else:
        with machine.lock:
            machine.do(line)
    return 'done'


async def main() -> None:
    logging.getLogger('pymodbus.logging').setLevel(logging.CRITICAL)  # of connections cut on demand
    parser = argparse.ArgumentParser()
    add = parser.add_argument
    add('--port', type=int, required=True)
    add('--link', type=Path, required=True)
    add('--log', type=Path, required=True)
    add('--wiring', choices=('reject', 'permit'), default='reject')
    add('--watchdog', type=float, default=0.25)
    add('--speed', type=float, default=0.5)
    add('--spacing', type=float, default=0.25)
    given = parser.parse_args()
    machine = Machine(given)
    server = Server(machine, given.port)
    await server.open()
    threading.Thread(target=machine.run, daemon=True).start()
    print('ready', flush=True)
    loop = asyncio.get_running_loop()
    try:
        while line := await loop.run_in_executor(None, sys.stdin.readline):
            print(await obey(line, machine, server), flush=True)
    finally:
        machine.port.unplug()


if __name__ == '__main__':
    asyncio.run(main())
