# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The registry of sources and the sources themselves."""

import subprocess
import sys
import time

import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError, Parameters
from checkweigher_core.recording import canonical_order
from checkweigher_core.records import LoadCell
from checkweigher_driver.devices import EYES, SOURCES, eyes_class, source_class, source_maker
from checkweigher_driver.sources import EdgeSource, Source
from checkweigher_driver.sources.simulator import LiveSimulationParameters
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation import simulator
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate


@pytest.mark.parametrize(
    ('name', 'found', 'kind'),
    [(name, source_class(name), Source) for name in SOURCES]
    + [(name, eyes_class(name), EdgeSource) for name in EYES if name != 'none'],
)
def test_every_registered_source_keeps_the_interface(name, found, kind):
    assert issubclass(found, kind)
    assert issubclass(found.parameters, Parameters)
    assert found.parameters.node == name


def test_a_source_with_eyes_of_its_own_takes_no_others(tmp_path):
    def read(kind):
        return kind.from_mapping({'count': 1} if kind.node == 'simulator' else {})

    assert source_maker('simulator', 'none', read)().paced
    with pytest.raises(ParameterError, match="the source 'simulator' has its own eyes"):
        source_maker('simulator', 'replayed', read)
    with pytest.raises(ParameterError, match=r"eyes: 'laser' is not one of .*replayed"):
        source_maker('aed', 'laser', read)
    with pytest.raises(ParameterError, match="'adc' is not one of simulator, bag, aed, ascii"):
        source_class('adc')


def test_the_simulator_delivers_its_line():
    parameters = SimulationParameters(count=2)
    source = source_class('simulator')(parameters)
    assert source.paced
    assert isinstance(source.load_cell, LoadCell)
    begin = source.start_stamp
    events = list(source)
    source.close()

    assert begin == events[0].stamp
    assert [*map(canonical_order, events)] == [*map(canonical_order, simulate(parameters))]


def test_each_stream_of_a_simulator_begins_now_and_none_before_the_end_of_another():
    source = source_class('simulator')(LiveSimulationParameters(count=1, lead_in=0.1))
    streams = [(time.time_ns(), *(event.stamp for event in source)) for _ in range(2)]
    (began, *first), (_, *second) = streams
    assert began <= first[0] <= time.time_ns()
    assert second[0] > first[-1]
    assert np.diff(first).tolist() == np.diff(second).tolist()


def test_a_simulated_stream_begins_when_its_first_samples_are_ready(monkeypatch):
    ready = []

    def run(*arguments, of=simulator._Machine.run):
        found = of(*arguments)
        ready.append(time.time_ns())
        return found

    monkeypatch.setattr(simulator._Machine, 'run', run)
    events = iter(source_class('simulator')(LiveSimulationParameters(count=1)))
    assert next(events).stamp >= ready[0]


def test_the_bag_delivers_what_was_recorded(tmp_path):
    recording = simulate(SimulationParameters(count=2))
    write_bag(tmp_path / 'bag', recording.load_cell, recording)
    found = source_class('bag')
    source = found(found.parameters.from_mapping({'path': str(tmp_path / 'bag')}))

    assert source.load_cell == recording.load_cell
    assert source.start_stamp == recording.blocks[0].stamp
    assert [*map(canonical_order, source)] == [*map(canonical_order, recording)]


def test_a_bag_that_is_not_named_or_not_there_is_refused(tmp_path):
    found = source_class('bag')
    with pytest.raises(ParameterError, match=r'bag\.path: empty'):
        found(found.parameters())
    with pytest.raises(BagError, match='there is no such file'):
        found(found.parameters.from_mapping({'path': str(tmp_path / 'none')}))


def test_no_source_loads_scipy_before_it_is_begun():
    # It takes as long as all else that a line needs to start.
    code = (
        'import sys\n'
        'from checkweigher_driver.devices import SOURCES, source_class\n'
        'loaded = [source_class(name) for name in SOURCES]\n'
        'assert loaded and "scipy" not in sys.modules'
    )

    subprocess.run([sys.executable, '-c', code], check=True)
