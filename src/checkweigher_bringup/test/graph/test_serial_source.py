# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Graph with a serial load cell, which gives the masses of the bag that the device plays."""

from pathlib import Path

from checkweigher_msgs.msg import Verdict
from graph import make_stages
from lines import weigh_all
import pytest
from running import PATIENCE, ROOT  # noqa: F401  sets the domain
from serial_line import SerialDevice, aed_on

from checkweigher_bringup.listening import ResultListener
from checkweigher_bringup.spinning import spinning
from checkweigher_driver.driver_node import DriverNode
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import SimulationParameters, simulate

COUNT = 2


def test_the_graph_weighs_over_a_port_what_weigh_does_from_the_bag(tmp_path: Path):
    recording = simulate(SimulationParameters(count=COUNT, lead_in=1.1, run_out=0.3))
    cell, port, bag = recording.load_cell, tmp_path / 'port', tmp_path / 'bag'
    write_bag(bag, cell, recording)
    expected = [done.estimate.mass for done in weigh_all(recording)]
    device = SerialDevice(port, '--bag', bag)
    try:
        with spinning('serial') as spinner:
            listener = ResultListener('listener')
            spinner.add(listener)
            spinner.add(*make_stages())  # however long a busy machine takes for a mass
            eyes = {'eyes': 'replayed', 'replayed.path': str(bag)}
            spinner.add(DriverNode({**aed_on(port, cell), **eyes}))
            weighings = [listener.weighings.get(timeout=PATIENCE) for _ in range(COUNT)]
    finally:
        device.end()

    assert [w.verdict.decision for w in weighings] == [Verdict.ACCEPT] * COUNT
    # Samples and windows are the same; the times are those of this machine's clock, which goes
    # into the mass by a tenth of what it is off during a pass, in the first second of the stream.
    masses = [w.estimate.mass for w in weighings]
    assert masses == pytest.approx(expected, rel=1e-3, abs=1 / cell.counts_per_kg)
