# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A load cell on a pseudo-terminal: answers, streams at the pace of its wire, and fails on demand.

    python test/support/devices/serial_device.py LINK --rate 1200 --baud 115200

LINK is where the port appears. What it reads from its standard input, line by line, happens at
once: `lose N` bytes, `corrupt` a byte, `junk N` bytes, `silence S` seconds, `stop` as by STP,
`unplug`, `replug`, `identity TEXT`, `level N` counts on the belt (signal slow). It ends with its
standard input.

What it answers follows the command list in docs/hardware.md, not the driver's code.
"""

import argparse
import contextlib
import os
from pathlib import Path
import pty
import select
import sys
import time
import tty

import numpy as np
from numpy.typing import NDArray

STEP = 7919  # odd, so that each value of the ramp tells its number


def ramp(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return readings that tell which they are; every byte value occurs in them, CR LF as well."""
    return (numbers * STEP) % 2**24 - 2**23


def number_of(count: int) -> int:
    """Return which reading of the ramp a value is, from 0 to 2**24."""
    return (count + 2**23) * pow(STEP, -1, 2**24) % 2**24


def slow(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return what an empty belt reads: a level and some counts of noise."""
    noise = (numbers * 2_654_435_761 % 2**32) % 61 - 30
    return 1_250_000 + noise


class Port:
    """A pseudo-terminal under a name that stays."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = self.slave = -1
        self.plug_in()

    def plug_in(self) -> None:
        if self.master >= 0:
            return
        # The other end stays open here, so that the wire is there also when no program listens.
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        new = self.link.with_name(self.link.name + '.new')
        new.unlink(missing_ok=True)
        new.symlink_to(os.ttyname(self.slave))
        new.rename(self.link)

    def unplug(self) -> None:
        if self.master < 0:
            return
        self.link.unlink()
        os.close(self.slave)
        os.close(self.master)
        self.master = self.slave = -1

    def write(self, data: bytes) -> None:
        if self.master >= 0 and data:
            with contextlib.suppress(BlockingIOError):  # bytes that are not read are gone
                os.write(self.master, data)


class Device:
    """What is behind the port."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.port = Port(options.link)
        self.identity = options.identity
        self.settings: dict[str, str] = {'ICR': '00', 'CSM': '0', 'COF': '3'}
        self.streaming = options.protocol == 'ascii'
        self.begin = time.monotonic()
        self.sent = 0
        self.asked = False
        self.quiet_until = 0.0
        self.level = 0
        self.lose = self.corrupt = 0
        self.junk = b''
        self.received = b''
        self.recorded = None
        if options.bag:
            from checkweigher_recording.bags.reading import read_bag

            self.recorded = np.concatenate([b.counts for b in read_bag(options.bag).blocks])

    def counts(self, first: int, end: int) -> NDArray[np.int64]:
        numbers = np.arange(first, end)
        if self.recorded is not None:
            return self.recorded[first:end].astype(np.int64)
        return ramp(numbers) if self.options.signal == 'ramp' else slow(numbers) + self.level

    def frame(self, count: int) -> bytes:
        if self.options.protocol == 'ascii':
            return b'S%+08d\r\n' % count
        data = (count & 0xFFFFFF).to_bytes(3, 'big')
        checked = self.settings['CSM'] == '1'
        check = data[0] ^ data[1] ^ data[2] if checked else self.options.status
        return data + bytes([check]) + (b'\r\n' if self.options.trailer == 'crlf' else b'')

    def stream(self) -> None:
        """Put on the wire what has gone over it by now."""
        options = self.options
        now = time.monotonic()
        wire = 10 * len(self.frame(0)) / options.baud
        due = int((now - self.begin - wire) * options.rate) + 1
        if self.recorded is not None:
            due = min(due, len(self.recorded))
        first, self.sent = self.sent, max(due, self.sent)
        if not self.streaming or time.monotonic() < self.quiet_until:
            return
        data = bytearray(b''.join(self.frame(c) for c in self.counts(first, self.sent).tolist()))
        if not data:
            return
        if self.corrupt:
            data[len(data) // 2] ^= 1 << self.corrupt % 8
            self.corrupt = 0
        cut = min(self.lose, len(data))
        self.lose -= cut
        self.port.write(self.junk + bytes(data[cut:]))
        self.junk = b''

    def answer(self) -> None:
        """Read commands and reply."""
        with contextlib.suppress(BlockingIOError, OSError):
            self.received += os.read(self.port.master, 4096)
        *commands, self.received = self.received.split(b';')
        for command in commands:
            reply = self.reply(command.decode('ascii', 'replace').strip())
            if reply is not None and not self.options.mute:
                self.port.write(f'{reply}\r\n'.encode())

    def reply(self, command: str) -> str | None:
        name, argument = command[:3], command[3:].strip()
        if command == 'STP':
            self.streaming = False
            return None
        if command == 'RES':
            self.quiet_until = time.monotonic() + self.options.reset_time
            self.streaming = False
            return None
        if time.monotonic() < self.quiet_until or (command[:1] == 'S' and command[1:].isdigit()):
            return None
        if name in self.options.refuse:
            return '?'
        if command == 'IDN?':
            time.sleep(self.options.late)
            self.options.late = 0.0
            return self.identity
        if command == 'BDR?':
            return f'{self.options.baud},0'
        if command == 'ICR?':
            return self.settings['ICR']
        if command == 'MSV?0' and self.settings['COF'] == '8':
            self.streaming = True
            if self.recorded is not None and not self.asked:
                self.begin, self.sent = time.monotonic(), 0
                if self.options.begin:
                    new = self.options.begin.with_suffix('.new')
                    new.write_text(str(time.time_ns()))
                    new.rename(self.options.begin)
            self.asked = True
            self.stream_from_now()
            return None
        if name in ('STR', 'COF', 'CSM', 'ICR', 'ASF', 'FMD') and argument.isdigit():
            self.settings[name] = argument
            return '0'
        return '?'

    def stream_from_now(self) -> None:
        """Begin with the next sample that is taken."""
        self.sent = max(self.sent, int((time.monotonic() - self.begin) * self.options.rate))

    def do(self, line: str) -> None:
        """Do what a line says."""
        word, _, value = line.strip().partition(' ')
        if word == 'lose':
            self.lose = int(value)
        elif word == 'corrupt':
            self.corrupt = 5
        elif word == 'junk':
            self.junk = bytes(range(1, 1 + int(value)))
        elif word == 'silence':
            self.quiet_until = time.monotonic() + float(value)
        elif word == 'stop':
            self.streaming = False
        elif word == 'unplug':
            self.streaming = self.streaming and self.options.protocol == 'ascii'
            self.port.unplug()
        elif word == 'replug':
            self.port.plug_in()
        elif word == 'level':
            self.level = int(value)
        elif word == 'identity':
            self.identity = value
        else:
            raise SystemExit(f'no such command: {line!r}')

    def run(self) -> None:
        print('ready', flush=True)
        pace = 1 / self.options.rate
        while True:
            watched = [sys.stdin] + ([self.port.master] if self.port.master >= 0 else [])
            ready, _, _ = select.select(watched, [], [], pace if self.streaming else 0.05)
            if self.port.master in ready:
                self.answer()
            self.stream()
            if sys.stdin in ready:
                line = sys.stdin.readline()
                if not line:
                    return
                self.do(line)
                print('done', flush=True)


def options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('link', type=Path)
    parser.add_argument('--protocol', choices=('aed', 'ascii'), default='aed')
    parser.add_argument('--rate', type=float, default=960.0, help='values a second')
    parser.add_argument('--baud', type=int, default=115_200)
    parser.add_argument('--trailer', choices=('crlf', 'none'), default='crlf')
    parser.add_argument('--status', type=int, default=8, help='status byte, without checksum')
    parser.add_argument('--signal', choices=('ramp', 'slow'), default='ramp')
    parser.add_argument('--bag', type=Path, help='send the readings of a bag instead')
    parser.add_argument('--begin', type=Path, help='is written when the bag begins: the time, ns')
    parser.add_argument('--identity', default='HBM,FIT/5,0123456,P72')
    parser.add_argument('--late', type=float, default=0.0, help='s, of the first reply to IDN?')
    parser.add_argument('--refuse', nargs='*', default=[], help='commands that are replied to by ?')
    parser.add_argument('--mute', action='store_true', help='reply to nothing')
    parser.add_argument('--reset-time', type=float, default=3.0)
    return parser


def main() -> None:
    device = Device(options().parse_args())
    try:
        device.run()
    finally:
        device.port.unplug()


if __name__ == '__main__':
    main()
