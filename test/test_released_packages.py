# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packages that bloom can release, with nothing but what apt has of their package.xml."""

from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, distribution, distributions
import json
import os
from pathlib import Path
import queue
import re
import subprocess
import sys

from catkin_pkg.package import parse_package
import pytest
from running import PATIENCE, ROOT, printed
from serial_line import CELL, SerialDevice

from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import spinning
from checkweigher_core.records import Decision, StreamStatus
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode

Python = tuple[list[str], dict[str, str]]
RELEASED = ('msgs', 'core', 'dsp', 'production', 'driver')
# The distributions of rosdep's keys. Those of ROS are the wheels.
OF_APT = {
    'python3-cryptography': 'cryptography',
    'python3-numpy': 'numpy',
    'python3-pywt': 'PyWavelets',
    'python3-serial': 'pyserial',
    'python3-yaml': 'PyYAML',
}
# Modules of devices that are installed by pip, with the package that each needs first.
ASKED_FOR = {
    'checkweigher_driver.line_io.gpio': 'gpiod',
    'checkweigher_driver.line_io.modbus': 'pymodbus',
    'checkweigher_driver.line_io.modbus_link': 'pymodbus',
    'checkweigher_driver.sources.bag': 'checkweigher_recording',
    'checkweigher_driver.sources.simulator': 'checkweigher_recording',
}
IMPORT_ALL = """
from importlib import import_module
import json, pkgutil, sys
missing = {}
for name in sys.argv[1:]:
    package = import_module(name)
    for module in pkgutil.walk_packages(package.__path__, name + '.'):
        try:
            import_module(module.name)
        except ModuleNotFoundError as error:
            missing[module.name] = error.name.split('.')[0]
print(json.dumps(missing))
"""


@pytest.fixture(scope='module')
def python(tmp_path_factory: pytest.TempPathFactory) -> Python:
    """Return the command and the environment of a Python that sees the released packages alone."""
    try:
        distribution('ros-jazzy-rclpy')
    except PackageNotFoundError:
        pytest.skip('the packages of a ROS installation are not apart from those of pip')
    keys = {
        str(key.name)
        for name in RELEASED
        for key in parse_package(str(ROOT / f'src/checkweigher_{name}')).exec_depends
    }
    left = [name for key, name in OF_APT.items() if key in keys]
    names = (each.metadata['Name'] for each in distributions())
    left += [name for name in names if name.startswith('ros-jazzy-')]
    folder, seen = tmp_path_factory.mktemp('apt'), set()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        found = distribution(name)
        for top in {file.parts[0] for file in found.files or () if file.parts[0] != '..'}:
            if not (folder / top).is_symlink():
                (folder / top).symlink_to(Path(str(found.locate_file(top))))
        left += [
            re.split(r'[^\w.-]', each)[0] for each in found.requires or () if 'extra ==' not in each
        ]
    workspace = [
        path
        for path in os.environ['PYTHONPATH'].split(os.pathsep)
        if any(f'checkweigher_{name}' in Path(path).parts for name in RELEASED)
    ]
    path = os.pathsep.join([str(folder), *workspace])
    return [sys.executable, '-S'], {**os.environ, 'PYTHONPATH': path}


def test_every_module_is_imported_but_those_of_devices_by_pip(python):
    command, environment = python
    names = [f'checkweigher_{name}' for name in RELEASED]
    done = subprocess.run(
        [*command, '-c', IMPORT_ALL, *names], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == ASKED_FOR


@pytest.mark.parametrize(
    ('module', 'parameter', 'value', 'package'),
    [
        ('checkweigher_driver.driver_node', 'source', 'bag', 'checkweigher_recording'),
        ('checkweigher_driver.driver_node', 'outputs', 'modbus', 'pymodbus'),
        ('checkweigher_driver.driver_node', 'inputs', 'gpio', 'gpiod'),
        ('checkweigher_dsp.nodes.identifier', 'estimator', 'iswd_eksi_paper', 'filterpy'),
    ],
)
def test_a_missing_package_is_one_line(python, module, parameter, value, package):
    command, environment = python
    done = subprocess.run(
        [*command, '-m', module, '--ros-args', '-p', 'source:=aed', '-p', f'{parameter}:={value}'],
        env=environment, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert f"{parameter}: '{value}' needs the Python package {package}, which is" in done.stderr


@pytest.fixture
def start(python: Python) -> Iterator[Callable[..., None]]:
    """Start Python with arguments, in the namespace of these tests."""
    command, environment = python
    nodes = []

    def begin(*arguments: object) -> None:
        words = [*map(str, arguments), '--ros-args', '-r', '__ns:=/released']
        nodes.append(subprocess.Popen([*command, *words], env=environment))

    yield begin
    for node in nodes:
        node.terminate()
    assert {node.wait(PATIENCE) for node in nodes} == {0}


def test_a_line_weighs(start, tmp_path: Path):
    with spinning('released') as spinner:
        spinner.add(listener := ResultListener('listener'))
        start(printed('own_driver', tmp_path))
        for name, module in ports.NODES.items():
            if name != 'driver':
                start('-m', module, '--ros-args', '-p', 'rejector_distance:=8.0')
        weighing = listener.weighings.get(timeout=PATIENCE)
    assert weighing.verdict.decision is Decision.ACCEPT
    assert weighing.verdict.mass == pytest.approx(0.2, abs=1e-4)


def test_a_driver_reads_a_serial_load_cell(start, tmp_path: Path):
    device = SerialDevice(tmp_path / 'port', '--signal', 'slow')
    received: queue.Queue[StreamStatus] = queue.Queue()
    try:
        with spinning('released') as spinner:
            node = PortNode('listener')
            node.subscribe(ports.SEGMENTER_STATUS, received.put)
            spinner.add(node)
            cell = {'port': tmp_path / 'port', **CELL}
            values = [word for name in cell for word in ('-p', f'aed.{name}:={cell[name]}')]
            start('-m', ports.NODES['segmenter'])
            start('-m', ports.NODES['driver'], '--ros-args', '-p', 'source:=aed', *values)
            while received.get(timeout=PATIENCE).samples < 1000:
                pass
    finally:
        device.end()
