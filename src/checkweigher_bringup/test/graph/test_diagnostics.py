# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Diagnostics over real DDS, of a line without faults and of each kind of fault."""

from dataclasses import replace
from pathlib import Path
import re
import threading
from typing import Any

from graph import publish, wait_for
from lines import simulated
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from reject_line import START, RejectLine, edges
from running import PATIENCE, ROOT, run_command

from checkweigher_bringup.commands.line.status import lane_table, table
from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.health.findings import Level
from checkweigher_core.records import EyeEdge, SampleBlock
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.status_board import Row, StatusBoard, headline
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.nodes.segmenter import SegmenterNode
from checkweigher_production.nodes.product import ProductNode

LANE = 'diagnosed'
# Whether these are well depends on what else the machine does meanwhile.
OF_THE_MACHINE = ('Clock', 'Verdicts', 'Line', 'Windows', 'Permission')


class Told:
    """Listener with the latest status of each aspect, and each status that was not OK."""

    def __init__(self, spinner: Spinner) -> None:
        self.node = Node('others')
        self.last: dict[str, Any] = {}
        self.bad: list[tuple[str, str]] = []
        self._lock = threading.Lock()
        topic = ports.DIAGNOSTICS
        self.node.create_subscription(topic.type, topic.name, self._on_message, topic.qos)
        spinner.add(self.node)

    def _on_message(self, message: Any) -> None:
        with self._lock:
            for status in message.status:
                self.last[status.name] = status
                if status.level[0]:
                    self.bad.append((status.name, status.message))

    def aspect(self, name: str) -> tuple[Level, str]:
        """Return level and message of an aspect such as 'segmenter: Zero'."""
        status = self.last.get(f'{LANE}/{name}')
        return (Level.OK, '') if status is None else (Level(status.level[0]), status.message)

    def values(self, name: str) -> dict[str, str]:
        """Return the values of an aspect."""
        return {value.key: value.value for value in self.last[f'{LANE}/{name}'].values}

    def wait(self, name: str, level: Level, text: str, timeout: float = PATIENCE) -> str:
        """Wait until an aspect has a level and a text, and return its hint."""
        wait_for(
            lambda: self.aspect(name)[0] == level and text in self.aspect(name)[1], text, timeout
        )
        return self.aspect(name)[1].partition('; ')[2]

    def rows(self) -> dict[str, Level]:
        """Return the levels of all aspects."""
        with self._lock:
            return {name: Level(status.level[0]) for name, status in self.last.items()}


def test_a_line_that_is_well_is_ok_in_every_aspect_until_its_driver_goes(spinner: Spinner):
    told = Told(spinner)
    for name, make in STAGE_NODES.items():
        # Time enough for a machine that is busy with something else.
        spinner.add(make({'rejector_distance': 3.0} if name == 'reject' else None))
    spinner.add(ProductNode())
    driver = DriverNode({'simulator.count': 0})
    spinner.add(driver)
    wait_for(lambda: 'ACCEPT' in str(told.last.get(f'{LANE}/reject: Verdicts')))
    wait_for(lambda: not any(told.rows().values()), timeout=60.0)

    def aspects() -> set[str]:
        return {name.partition(': ')[2] for name in told.rows()} - {''}

    wait_for(lambda: aspects() >= documented_aspects())  # some come with the first window
    assert aspects() == documented_aspects()
    assert [
        (name, text)
        for name, text in told.bad
        if ': ' in name and name.partition(': ')[2] not in OF_THE_MACHINE
    ] == []
    assert told.last[f'{LANE}/segmenter: Zero'].hardware_id == 'simulated/paper-1'
    # Not a number until there is a whole stretch of them.
    wait_for(lambda: float(told.values('segmenter: Samples')['received_samples_per_s']) > 0)

    def status() -> str:
        return run_command('status', '--count', 1, '--namespace', LANE).stdout

    wait_for(lambda: '  0 silent' in (shown := status()) and f'{LANE}/segmenter' in shown)

    spinner.remove(driver)
    hint = told.wait('segmenter: Samples', Level.ERROR, 'no samples for')
    assert 'check that the driver runs' in hint
    told.wait('segmenter: Connections', Level.ERROR, f'no publisher of /{LANE}/')
    assert told.aspect('segmenter')[0] == Level.ERROR
    spinner.add(DriverNode({'simulator.count': 0}))
    told.wait('segmenter: Samples', Level.OK, '')
    told.wait('segmenter: Connections', Level.OK, '')


def documented_aspects() -> set[str]:
    """Return the aspects of the table in the docs."""
    text = (ROOT / 'docs/reasons.md').read_text()
    section = re.search(r'^## Diagnostics\n(.*)', text, re.M | re.S)
    assert section
    return set(re.findall(r'^\| `([^`]+)` \|', section.group(1), re.M))


def test_what_is_wrong_with_the_signal_is_told_with_what_to_check(spinner: Spinner):
    line = simulated(count=3, speed=1.0, run_out=0.5)
    cell = line.load_cell
    shifted = replace(cell, zero_counts=cell.zero_counts + 0.25 * cell.counts_per_kg)
    lost = line.blocks[20]
    told = Told(spinner)
    node = SegmenterNode({'max_belt_noise': 1e-5})
    spinner.add(node)
    samples, eyes = (
        told.node.create_publisher(topic.type, topic.name, topic.qos)
        for topic in (ports.LOAD_CELL_SAMPLES, ports.PHOTO_EYES)
    )
    wait_for(lambda: samples.get_subscription_count() > 0 and eyes.get_subscription_count() > 0)
    publish(told.node, ports.LOAD_CELL_INFO, to_message(ports.LOAD_CELL_INFO, shifted, stamp=START))
    for event in sorted([*line.blocks, *line.edges], key=lambda event: event.stamp):
        if isinstance(event, EyeEdge):
            eyes.publish(to_message(ports.PHOTO_EYES, event))
        elif isinstance(event, SampleBlock) and event is not lost:
            samples.publish(to_message(ports.LOAD_CELL_SAMPLES, event))

    hint = told.wait('segmenter: Samples', Level.WARN, '10 samples lost in 1 gap in')
    assert 'network' in hint
    told.wait('segmenter: Zero', Level.WARN, 'the zero has used 83 % of zero_range')
    hint = told.wait('segmenter: Belt noise', Level.WARN, 'above max_belt_noise of 0.01 g')
    assert re.search(r'strongest at \d+\.\d Hz', hint)
    assert told.values('segmenter: Samples')['samples_lost'] == '10'
    told.wait('segmenter: Samples', Level.ERROR, 'no samples for')


def test_who_publishes_or_subscribes_with_another_qos_is_named(spinner: Spinner):
    told = Told(spinner)
    spinner.add(SegmenterNode())
    topic = ports.LOAD_CELL_SAMPLES
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    publisher = told.node.create_publisher(topic.type, topic.name, best_effort)

    name = 'segmenter: Connections'
    hint = told.wait(name, Level.ERROR, f'/{LANE}/others publishes /{LANE}/load_cell/samples')
    assert 'reliable subscription' in told.aspect(name)[1]
    assert hint == f'change the QoS of /{LANE}/others to that of docs/topics.md'
    told.node.destroy_publisher(publisher)
    wait_for(lambda: 'incompatible QoS' not in told.aspect(name)[1])

    # A subscriber that asks for more is only warned of.
    topic = ports.WEIGH_WINDOW
    told.node.create_subscription(
        topic.type, topic.name, lambda message: None, ports.LOAD_CELL_INFO.qos
    )
    wait_for(lambda: 'subscribes to' in str(told.bad))
    (text, *_) = [text for _, text in told.bad if 'subscribes to' in text]
    assert f'/{LANE}/others subscribes to /{LANE}/weigh_window' in text


def test_verdicts_that_come_late_and_masses_that_do_not_come_are_errors(spinner: Spinner):
    told = Told(spinner)
    # The rejector has to be told before the product is at the outfeed eye.
    line = RejectLine(spinner, rejector_distance=0.0, actuator_delay=0.1)
    for number in (1, 2, 3):
        for edge in edges(number):
            line.edges.publish(to_message(ports.PHOTO_EYES, edge))
    # The announcements come on another topic, and must not overtake the edges.
    line.wait_for_count('photo_eyes received', 9)
    for number in (1, 2, 3):
        line.announce(number)

    hint = told.wait('reject: Verdicts', Level.ERROR, '3 verdicts came after the reject time')
    assert 'actuator_delay' in hint
    hint = told.wait('reject: Line', Level.ERROR, 'no mass of the last 3 items has arrived')
    assert hint == 'identifier does not run: start it'


def test_a_message_that_cannot_be_used_is_told_of(spinner: Spinner):
    told = Told(spinner)
    spinner.add(RejectNode())
    publish(told.node, ports.LOAD_CELL_INFO, ports.LOAD_CELL_INFO.type())
    text = '1 messages refused in the last minute: load_cell/info: load cell: sample_rate is 0'
    wait_for(lambda: text in str(told.bad))
    assert told.values('reject')['last warning'].startswith('refused a message on load_cell/info')


def test_a_defect_of_the_diagnostics_does_not_end_the_node(spinner: Spinner):
    class Broken(SegmenterNode):
        def diagnose(self, now: float) -> Any:
            raise ZeroDivisionError('of a defect')

    told = Told(spinner)
    spinner.add(Broken())
    told.wait('segmenter: Diagnostics', Level.ERROR, 'ZeroDivisionError: of a defect')
    assert spinner.alive


def test_the_product_node_tells_of_its_recipe_and_its_log(spinner: Spinner, tmp_path: Path):
    told = Told(spinner)
    log = tmp_path / 'audit.log'
    recipes = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
    spinner.add(
        ProductNode({'recipes': str(recipes), 'product': 'crisps_150g', 'audit_log': str(log)})
    )
    hint = told.wait('product: Recipe', Level.ERROR, "product 'crisps_150g' is not selected yet")
    assert 'check that denoise, identifier and reject run' in hint
    told.wait('product: Audit log', Level.OK, str(log))
    log.unlink()
    told.wait('product: Audit log', Level.ERROR, f'{log}: No such file or directory')


class Status:
    """The fields of a DiagnosticStatus that `status` reads."""

    def __init__(self, name: str, level: int, message: str) -> None:
        self.name, self.level, self.message = name, bytes([level]), message
        self.values: list[Any] = []


def told_by(node: str, level: int = 0, message: str = 'running') -> list[Status]:
    worst = Status(node, level, message)
    return [worst, Status(f'{node}: Samples', level, message), Status(f'{node}: Items', 0, 'well')]


def test_the_status_shows_the_worst_first_and_who_is_silent():
    board = StatusBoard('a')
    board.add(10.0, told_by('a/segmenter', 1, 'it is; look'))
    board.add(12.0, told_by('a/reject', 2, 'bad; look'))
    board.add(12.0, told_by('a/denoise'))
    board.add(12.0, told_by('b/denoise', 2))
    board.add(12.0, told_by('a/camera', 2))

    def shown(now: float) -> list[tuple[str, str, str]]:
        return [(row.level.name, row.node, row.aspect) for row in board.rows(now)]

    assert shown(12.5) == [
        ('ERROR', 'a/reject', 'Samples'),
        ('STALE', 'a/identifier', ''),  # never heard
        ('WARN', 'a/segmenter', 'Samples'),
        ('OK', 'a/denoise', 'Items'),
        ('OK', 'a/denoise', 'Samples'),
        ('OK', 'a/reject', 'Items'),
        ('OK', 'a/segmenter', 'Items'),
    ]
    assert headline(board.rows(12.5)) == '1 silent, 1 error, 1 warning, 4 well'
    assert ('STALE', 'a/segmenter', '') in shown(13.5)


def test_the_status_has_the_hint_on_a_line_of_its_own_and_keeps_to_the_width():
    row = Row('a/segmenter', 'Belt noise', Level.WARN, 'too much; ' + 20 * 'check ', (('g', '5'),))
    lines = list(table([row, replace(row, level=Level.OK, message='2 g')], 80, values=False))
    assert max(map(len, lines)) <= 80
    assert lines[1].endswith('Belt noise  too much')
    assert lines[2].lstrip().startswith('-> check')
    assert [line for line in lines if line.strip() == 'g 5'] == lines[-2:-1]
    assert lines[-1].startswith('OK')


def test_the_lanes_show_the_worst_with_its_hint_to_the_end():
    hint = 'check rollers, belt joint, motor and floor'
    row = Row('a/segmenter', 'Belt noise', Level.WARN, f'5 g, 3 times the usual; {hint}')
    _, *lines = lane_table([row], 60)
    shown = ' '.join(' '.join(lines).split())
    assert shown == f'WARN a 0 0 0 segmenter Belt noise: 5 g, 3 times the usual -> {hint}'


def test_the_status_of_nothing_says_so_and_fails():
    done = run_command('status', '--duration', 1)
    assert done.returncode == 1
    assert 'no message on /diagnostics' in done.stdout
    assert 'Traceback' not in done.stderr
