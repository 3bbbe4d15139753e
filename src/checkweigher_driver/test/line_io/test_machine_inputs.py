# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Inputs of the machine: what they say, and over Modbus TCP against a server process."""

import time
from typing import Any

import pytest
from running import wait_for

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, ExternalReject, MachineConditions
from checkweigher_driver.line_io.gpio import GpioInputParameters
from checkweigher_driver.line_io.machine_inputs import InputWatch, MachineInputs, Reading
from checkweigher_driver.line_io.modbus import ModbusInputParameters, ModbusInputs
from checkweigher_driver.line_io.modbus_link import ModbusLink

GUARD, AIR, BIN, READY, METAL = 8, 9, 10, 11, 12
WELL = {'guards[0]': True, 'air[0]': True, 'bins[0]': True, 'inspections[0]': True, 'metal': False}


def test_an_edge_is_one_reject_however_long_the_input_stays_on():
    watch, on = InputWatch(1.0), {**WELL, 'metal': True}
    assert ExternalReject(5, 'metal') in watch.take(Reading(5, on))
    assert watch.take(Reading(9, on)) == []
    assert watch.take(Reading(12, WELL)) == []
    assert watch.take(Reading(15, on)) == [ExternalReject(15, 'metal')]


@pytest.mark.parametrize(
    ('name', 'reason'),
    [('guards[0]', 'GuardOpen'), ('air[0]', 'AirPressure'), ('inspections[0]', 'InspectionFault')],
)
def test_an_input_that_goes_off_is_a_condition_until_it_is_on(name: str, reason: str):
    watch = InputWatch(1.0)
    assert watch.take(Reading(1, WELL)) == [MachineConditions(1, True)]
    off = watch.take(Reading(5, {**WELL, name: False}))
    assert off == [MachineConditions(5, True, (reason,), (name,))]
    assert watch.take(Reading(9, WELL)) == [MachineConditions(9, True)]


def test_a_bin_is_full_when_no_product_falls_past_any_more():
    watch = InputWatch(1.0)
    full = {**WELL, 'bins[0]': False}
    watch.take(Reading(0, WELL))
    for stamp, levels in ((1, full), (NANOSECONDS // 2, WELL), (NANOSECONDS, full)):
        assert watch.take(Reading(stamp, levels)) == []
    (said,) = watch.take(Reading(2 * NANOSECONDS, full))
    assert isinstance(said, MachineConditions)
    assert said.conditions == ('BinFull',)


def test_inputs_of_a_plc_reject_stop_and_are_lost_with_it(plc: Any):
    plc.start()
    switch = ModbusLink('127.0.0.1', plc.port, 1, 2.0)
    switch.connect()
    for coil in (GUARD, AIR, BIN, READY):
        switch.write_coil(coil, True)
    conditions = {'guards': (GUARD,), 'air': (AIR,), 'bins': (BIN,), 'inspections': (READY,)}
    device = {'host': '127.0.0.1', 'port': plc.port, 'inputs': 'coil', 'timeout': 1.0}
    parameters = ModbusInputParameters(**device, **conditions, metal=METAL, bin_time=0.2)
    inputs, said = MachineInputs(ModbusInputs(parameters), parameters.bin_time), list[Any]()

    def last() -> Any:
        return next((s for s in reversed(said) if isinstance(s, MachineConditions)), None)

    inputs.open(said.append)
    try:
        wait_for(lambda: last() is not None and last().known and not last().conditions, 'inputs')
        assert inputs.trouble == ''
        before = time.time_ns()
        switch.write_coil(METAL, True)
        wait_for(lambda: any(isinstance(s, ExternalReject) for s in said), 'the reject')
        (reject,) = [s for s in said if isinstance(s, ExternalReject)]
        assert reject.device == 'metal'
        assert before <= (reject.stamp or 0) <= time.time_ns()
        for coil, reason in ((GUARD, 'GuardOpen'), (AIR, 'AirPressure'), (BIN, 'BinFull')):
            switch.write_coil(coil, False)
            wait_for(lambda reason=reason: last().conditions == (reason,), reason)
            assert reason in inputs.finding().text
            switch.write_coil(coil, True)
            wait_for(lambda: last().conditions == (), 'the end of it')
        plc.kill()
        wait_for(lambda: not last().known, 'the loss')
        assert 'the machine inputs cannot be read' in inputs.trouble
    finally:
        inputs.close()
        switch.close()


@pytest.mark.parametrize(
    ('values', 'text'),
    [
        ({}, 'no input is given'),
        ({'metal': 3, 'air': (3,)}, 'two inputs have the same address'),
        ({'metal': 3, 'air': (100,)}, 'one request cannot read all'),
        ({'metal': 3, 'inverted': 'doors'}, "'doors' is not one of metal, xray"),
    ],
)
def test_inputs_that_make_no_sense_are_refused(values: dict[str, Any], text: str):
    with pytest.raises(ParameterError, match=text):
        ModbusInputParameters(**values)


def test_an_inverted_input_is_named_without_its_number():
    parameters = GpioInputParameters(metal=1, guards=(2, 3), inverted='guards')
    assert parameters.wiring() == {'metal': 1, 'guards[0]': 2, 'guards[1]': 3}
    assert [parameters.is_inverted(name) for name in parameters.wiring()] == [False, True, True]
