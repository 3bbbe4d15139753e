# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rejector and stop over Modbus TCP, against a server process on a real port."""

import os
import time

from modbus_machine import MS, REJECTOR, RELEASE, permit, switching
from running import wait_for

from checkweigher_core.records import Decision, Verdict
from checkweigher_driver.line_io.belt_record import BeltRecord, OnBelt
from checkweigher_driver.line_io.modbus_link import ModbusLink


def run(outputs, plc):
    wait_for(lambda: outputs.trouble_with('') == '', 'the connection')
    outputs.activate()
    permit(outputs)
    released(plc)


def released(plc, on=True):
    wait_for(lambda: plc.state(RELEASE) is on, 'the release of the belt' if on else 'the stop')


def reject(item, due, decision=Decision.FAULT):
    return Verdict(item, due - 100 * MS, decision, reject_at=due)


def test_the_rejector_is_switched_when_it_is_due(plc):
    plc.start('--watchdog', 0.5)
    # However busy the machine is on which the test runs: no pulse is to be lost for it.
    with switching(plc, {'timeout': 2.0}, pulse=0.2, late_tolerance=2.0) as outputs:
        run(outputs, plc)
        first = time.time_ns() + 200 * MS
        dues = [first + number * 400 * MS for number in range(5)]
        for number, due in enumerate(dues):
            outputs.take(reject(number + 1, due))
            outputs.take(reject(100 + number, due + 300 * MS, Decision.ACCEPT))
        wait_for(lambda: outputs.finding().values['switches'] >= 10, 'the pulses')
        figures = outputs.finding().values
        assert outputs.trouble_with('') == ''
    seen = [(when, on) for when, on in plc.switches(REJECTOR) if when > dues[0] - 50 * MS]
    assert [on for _, on in seen[:10]] == [True, False] * 5
    wanted = [due + length for due in dues for length in (0, 200 * MS)]
    late = [when - due for (when, _), due in zip(seen, wanted, strict=False)]
    print(f'switched {min(late) / MS:.3f} to {max(late) / MS:.3f} ms after it was due; {figures}')
    # Never early; and how late it was it knows itself.
    stated = figures['largest_switch_error_ms'] + figures['switch_uncertainty_ms']
    assert 0 < min(late) <= max(late) <= (stated + 0.5) * MS
    assert figures['rejects'] == 5
    assert figures['late_rejects'] == figures['output_losses'] == 0


def test_outputs_are_safe_before_they_are_active_and_after(plc):
    plc.start('--watchdog', 0.5)
    with switching(plc) as outputs:
        wait_for(lambda: plc.state(RELEASE) is not None, 'the first write')
        assert plc.state(REJECTOR) is True  # ejects
        assert plc.state(RELEASE) is False
        outputs.activate()
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the safe state')
        assert plc.state(RELEASE) is False  # nothing has said that the line may run
        fall_silent, began = permit(outputs), time.time_ns()
        released(plc)
        wait_for(lambda: time.time_ns() > began + 1000 * MS, 'a second of permission')
        assert plc.state(RELEASE) is True
        fall_silent()
        silent = time.time_ns()
        released(plc, False)
        assert plc.state(REJECTOR) is False
        print(f'stopped after {(plc.switches(RELEASE)[-1][0] - silent) / MS:.0f} ms of silence')
        permit(outputs)
        released(plc)
        outputs.safe()
        wait_for(lambda: plc.state(REJECTOR) is True, 'the safe state')
        outputs.activate()
        released(plc)
    assert plc.state(REJECTOR) is True
    assert plc.state(RELEASE) is False


def test_trouble_of_load_cell_or_eyes_stops_the_line_that_has_permission(plc):
    plc.start()
    trouble = []
    with switching(plc, held=lambda: bool(trouble)) as outputs:
        run(outputs, plc)
        trouble.append('the load cell is unplugged')
        released(plc, False)
        trouble.clear()
        released(plc)
        assert outputs.trouble_with('') == ''


def test_a_device_that_restarts_gets_the_safe_state_first_and_a_missed_reject_stops_the_line(plc):
    plc.start()
    with switching(plc, {'timeout': 0.1}, pulse=0.02) as outputs:
        run(outputs, plc)
        due = time.time_ns() + 300 * MS
        outputs.take(reject(1, due))
        plc.kill()
        wait_for(lambda: 'cannot be reached' in outputs.trouble_with(''), 'the loss')
        wait_for(lambda: time.time_ns() > due + 50 * MS, 'the missed pulse')
        plc.log.unlink()
        plc.start()
        wait_for(lambda: 'look behind it' in outputs.trouble_with(''), 'the stop')
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the safe state')
        assert plc.switches(REJECTOR)[0][1] is True
        assert [on for _, on in plc.switches(RELEASE)] == [False]
        assert outputs.finding().values['output_losses'] == 1


def test_an_emptied_record_of_a_bad_product_holds_the_belt_until_a_person_has_looked(plc, tmp_path):
    record = tmp_path / 'belt'
    kept = BeltRecord(record)
    kept.keep(OnBelt(released=True, items=('item 7 UNDER',)))
    kept.close(OnBelt(released=True, items=('item 7 UNDER',)))  # what a kill leaves
    os.truncate(record, 0)
    plc.start()
    with switching(plc, record=str(record)) as outputs:
        outputs.activate()
        permit(outputs)
        wait_for(lambda: plc.state(REJECTOR) is False, 'the end of the safe state')
        assert plc.state(RELEASE) is False
        assert 'may not have been empty' in outputs.reset()
        released(plc)


def test_the_belt_input_holds_the_rejector_back(plc):
    plc.start()
    link = ModbusLink('127.0.0.1', plc.port, 1, 1.0)
    link.connect()
    with switching(plc, {'belt': 2}, pulse=0.1, belt_margin=0.0, late_tolerance=5.0) as outputs:
        run(outputs, plc)

        def belt_runs():
            return outputs.finding().values['belt_runs']

        wait_for(lambda: belt_runs() == 'yes' and plc.state(REJECTOR) is False, 'the belt')
        due = time.time_ns() + 400 * MS
        outputs.take(reject(1, due))
        link.write_register(1, 1)
        wait_for(lambda: belt_runs() == 'no', 'the stop')
        wait_for(lambda: time.time_ns() > due + 200 * MS, 'the time without the stop')
        assert plc.state(REJECTOR) is False
        link.write_register(1, 0)
        wait_for(lambda: plc.state(REJECTOR) is True, 'the pulse')
        assert outputs.trouble_with('') == ''
    link.close()
