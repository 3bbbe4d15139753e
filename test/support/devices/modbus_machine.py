# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A PLC in a process of its own, and eyes and outputs that are connected to it."""

from contextlib import contextmanager
import json
from pathlib import Path
import subprocess
import sys
import threading
import time

from running import BAGS, PATIENCE, free_port

from checkweigher_core.records import Permission
from checkweigher_driver.line_io.modbus import (
    ModbusEyes,
    ModbusEyesParameters,
    ModbusOutputParameters,
    ModbusOutputs,
)
from checkweigher_driver.line_io.outputs import MachineOutputs
from checkweigher_driver.line_io.rejector_control import OutputParameters

PLC = Path(__file__).with_name('modbus_plc.py')
BAG = BAGS / 'paper_90'
REJECTOR, RELEASE = 0, 1
MS = 1_000_000


class Plc:
    """The server process, and what was written to its coils."""

    def __init__(self, folder):
        self.port = free_port()
        self.log = folder / f'coils_{self.port}.jsonl'
        self.process = None

    def start(self, *arguments):
        command = [sys.executable, PLC, '--port', self.port, '--log', self.log, *arguments]
        self.process = subprocess.Popen(
            [str(word) for word in command], stdout=subprocess.PIPE, text=True
        )
        word, began = self.process.stdout.readline().split()
        assert word == 'ready'
        return int(began)

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    def switches(self, coil):
        """Return when a coil was switched (ns) and to what."""
        lines = [json.loads(line) for line in self.log.read_text().splitlines()]
        return [(when, value) for when, written, value in lines if written == coil]

    def state(self, coil, time=None):
        """Return what a coil is, or was at a time, ns; None before the first write."""
        found = self.switches(coil) if self.log.exists() else []
        states = [value for when, value in found if time is None or when <= time]
        return states[-1] if states else None


@contextmanager
def reading(plc, **parameters):
    """Read the eyes in a thread, as the machine does; give the source and what it said."""
    eyes = ModbusEyes(ModbusEyesParameters(host='127.0.0.1', port=plc.port, **parameters))
    events = []

    def read():
        for event in eyes.events():
            events.append(event)

    thread = threading.Thread(target=read)
    thread.start()
    try:
        yield eyes, events
    finally:
        eyes.close()
        thread.join(PATIENCE)
        assert not thread.is_alive()


@contextmanager
def switching(plc, port_parameters=None, held=lambda: False, **parameters):
    port = ModbusOutputs(
        ModbusOutputParameters(
            host='127.0.0.1', port=plc.port, stop=RELEASE, watchdog=0, **(port_parameters or {})
        )
    )
    outputs = MachineOutputs(port, OutputParameters(**parameters))
    outputs.open(held)
    try:
        yield outputs
    finally:
        outputs.close()


def outputs_of(plc):
    """Return parameters of the driver for its outputs, however busy the host is."""
    return {
        'outputs': 'modbus',
        'modbus_outputs.host': '127.0.0.1',
        'modbus_outputs.port': plc.port,
        'modbus_outputs.stop': RELEASE,
        'modbus_outputs.watchdog': 0,
        'modbus_outputs.belt': 2,  # it never stops: a bag goes on whatever the line asks for
        'modbus_outputs.timeout': 2.0,
        'rejector.late_tolerance': 2.0,
        'rejector.watchdog_time': 5.0,
    }


def permit(outputs):
    """Give the permission to run, again and again; return what ends that, as a dead reject does."""
    ended = threading.Event()

    def give():
        while outputs.is_open and not ended.is_set():
            outputs.take(Permission(time.time_ns(), run=True))
            ended.wait(0.1)

    threading.Thread(target=give, daemon=True).start()
    return ended.set
