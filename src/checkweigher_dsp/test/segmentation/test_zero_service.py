# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The service zero of the segmenter node, over real DDS."""

import time

from node_process import Process, process  # noqa: F401
import pytest
from std_srvs.srv import Trigger
from synthetic_line import make_line

from checkweigher_core.ros.ports import LOAD_CELL_INFO, LOAD_CELL_SAMPLES, ZERO, ZERO_SETTING
from checkweigher_dsp.nodes.segmenter import SegmenterNode


def _call(process: Process, client):  # noqa: F811
    process.wait_for(client.service_is_ready)
    return client.call_async(Trigger.Request())


def test_without_a_load_cell_the_service_says_so(process):  # noqa: F811
    caller = process.node()
    process.spinner.add(SegmenterNode(), caller)
    answer = _call(process, caller.create_client(Trigger, ZERO))
    process.wait_for(answer.done)
    assert not answer.result().success
    assert answer.result().message == 'no load_cell/info has arrived: not zeroed'


def test_the_service_answers_when_the_belt_was_zeroed(process):  # noqa: F811
    line, settings = make_line((0.1,), first_entry=12.0), []
    driver = process.node()
    info, samples = driver.output(LOAD_CELL_INFO), driver.output(LOAD_CELL_SAMPLES)
    driver.subscribe(ZERO_SETTING, settings.append)
    client = driver.create_client(Trigger, ZERO)
    process.spinner.add(SegmenterNode(), driver)
    info.send(line.load_cell, stamp=0)

    answer = _call(process, client)
    for block in line.blocks(size=96):  # the belt is empty for 12 s, and 7 s are needed
        samples.send(block)
        time.sleep(0.1)
        if answer.done():
            break
    process.wait_for(answer.done)

    assert answer.result().success
    assert answer.result().message.startswith('zeroed at 0.000000 kg')
    process.wait_for(lambda: settings)
    assert (settings[-1].zero, settings[-1].previous) == pytest.approx((0.0, 0.0), abs=1e-6)
