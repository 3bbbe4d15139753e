# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Photo-eyes and rejector on GPIO lines: events of the kernel, and gpio-sim where there is one."""

from contextlib import suppress
from pathlib import Path
import subprocess
import threading
import time

from gpiod import EdgeEvent
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Eye, EyeEdge
from checkweigher_driver.line_io.gpio import (
    EdgeOrder,
    GpioEyes,
    GpioEyesParameters,
    GpioOutputParameters,
    GpioOutputs,
)
from checkweigher_driver.line_io.rejector.switching import Levels
from checkweigher_driver.sources import EyesBack, EyesLost

CONFIG = Path('/sys/kernel/config/gpio-sim')
PATIENCE = 10.0  # s
RISING, FALLING = EdgeEvent.Type.RISING_EDGE.value, EdgeEvent.Type.FALLING_EDGE.value
EYES = {4: Eye.INFEED, 7: Eye.OUTFEED}


def test_events_of_the_kernel_become_edges_with_its_stamps():
    order = EdgeOrder(EYES)
    assert order.take(EdgeEvent(RISING, 1000, 4, 1, 1)) == [EyeEdge(1000, Eye.INFEED, True)]
    assert order.take(EdgeEvent(FALLING, 2000, 4, 2, 2)) == [EyeEdge(2000, Eye.INFEED, False)]
    assert order.take(EdgeEvent(RISING, 2500, 7, 3, 1)) == [EyeEdge(2500, Eye.OUTFEED, True)]
    assert order.lost == 0


def test_events_that_the_kernel_dropped_are_a_loss_of_the_eyes():
    order = EdgeOrder(EYES)
    order.take(EdgeEvent(RISING, 1000, 4, 1, 1))
    lost, back, edge = order.take(EdgeEvent(FALLING, 9000, 4, 5, 3))
    assert isinstance(lost, EyesLost)
    assert lost.stamp == 1000
    assert '3 edges' in lost.text
    assert back == EyesBack(8999)
    assert edge == EyeEdge(9000, Eye.INFEED, False)
    assert order.lost == 3


def test_a_chip_that_is_not_there_is_said_to():
    with pytest.raises(ParameterError, match=r'gpio\.chip: /dev/gpiochip99: No such file'):
        GpioEyes(GpioEyesParameters(chip='/dev/gpiochip99'))
    port = GpioOutputs(GpioOutputParameters(chip='/dev/null'))
    with pytest.raises(ParameterError, match=r'gpio_outputs\.chip: /dev/null'):
        port.open(Levels(True, True))


@pytest.mark.parametrize(
    ('kind', 'values', 'message'),
    [
        (GpioEyesParameters, {'outfeed': 0}, 'is also the line of the infeed eye'),
        (GpioOutputParameters, {'stop': 2}, 'must be different lines'),
    ],
)
def test_lines_that_are_used_twice_are_refused(kind, values, message):
    with pytest.raises(ParameterError, match=message):
        kind(**values)


@pytest.fixture
def simulated_chip():
    """Make a chip of gpio-sim; return its device and the folder that sets and reads its lines."""
    with suppress(OSError):
        subprocess.run(['modprobe', 'gpio-sim'], check=False, capture_output=True)
    if not CONFIG.is_dir():
        pytest.skip('this kernel has no gpio-sim: GPIO lines were not tested')
    chip = CONFIG / f'checkweigher{time.time_ns()}'
    bank = chip / 'bank0'
    try:
        bank.mkdir(parents=True)
        (bank / 'num_lines').write_text('8')
        (chip / 'live').write_text('1')
    except PermissionError:
        pytest.skip('no permission to make a chip of gpio-sim: GPIO lines were not tested')
    name = (bank / 'chip_name').read_text().strip()
    folder = Path('/sys/devices/platform') / (chip / 'dev_name').read_text().strip() / name
    yield f'/dev/{name}', folder
    (chip / 'live').write_text('0')
    bank.rmdir()
    chip.rmdir()


def test_edges_of_a_simulated_chip_come_with_the_stamps_of_the_kernel(simulated_chip):
    device, folder = simulated_chip
    eyes = GpioEyes(GpioEyesParameters(chip=device, outfeed_active_low=True))
    found = []
    thread = threading.Thread(target=lambda: found.extend(eyes.events()))
    thread.start()
    pulled = []
    for line, pull in ((0, 'pull-up'), (1, 'pull-up'), (0, 'pull-down'), (1, 'pull-down')):
        before = time.time_ns()
        (folder / f'sim_gpio{line}/pull').write_text(pull)
        pulled.append((before, time.time_ns()))
    end = time.monotonic() + PATIENCE
    while eyes.figures()['edges'] < 4 and time.monotonic() < end:
        time.sleep(0.01)
    eyes.close()
    thread.join()
    seen = [(edge.eye, edge.blocked) for edge in found]
    assert seen == [(eye, on) for on in (True, False) for eye, on in ((0, on), (1, not on))]
    for edge, (before, after) in zip(found, pulled, strict=True):
        assert before <= edge.stamp <= after


def test_outputs_of_a_simulated_chip_are_set_and_the_belt_is_read(simulated_chip):
    device, folder = simulated_chip

    def value(line):
        return int((folder / f'sim_gpio{line}/value').read_text())

    port = GpioOutputs(
        GpioOutputParameters(chip=device, reject=2, stop=3, belt=4, permit=5, heartbeat=6)
    )
    port.open(Levels(True, True))
    assert (value(2), value(3)) == (1, 0)  # the line may run while line 3 is high
    port.switch(Levels(False, False))
    assert (value(2), value(3)) == (0, 1)
    assert port.refresh(Levels(False, False)) is False
    (folder / 'sim_gpio4/pull').write_text('pull-up')
    beat = value(6)
    assert port.refresh(Levels(False, False, True)) is True
    assert (value(5), value(6)) == (1, 1 - beat)
    port.close()
