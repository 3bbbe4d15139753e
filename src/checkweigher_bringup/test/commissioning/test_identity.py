# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Changes of a machine during its verification."""

import json
from pathlib import Path

from checkweigher_bringup.commissioning.identity import Identity
from checkweigher_production.audit_log import AuditLog


def test_operating_a_simulated_machine_is_no_change_of_it(tmp_path: Path):
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        audit.append('2026-05-28T20:00:00', '/product', 'parameter', '/driver.rate', 1.0, 2.0)
    identity = Identity(tmp_path / 'parameters.yaml', log)
    before = {'driver': {'simulator.now.mass': 0.0, 'rate': 2.0}}
    identity.at_begin(before, 'on a running line')
    with AuditLog(log) as audit:
        for name, old, new in (('simulator.now.mass', 0.0, 0.125), ('rate', 2.0, 3.0)):
            audit.append(
                '2026-05-28T20:01:00', '/product', 'parameter', f'/driver.{name}', old, new
            )
    after = {'driver': {'simulator.now.mass': 0.125, 'rate': 3.0}}
    assert json.loads(identity.at_end(after))['changes'] == [
        'Parameter driver.rate was 2.0 before the first step and 3.0 after the last step.',
        'Audit log, 2026-05-28T20:01:00: parameter /driver.rate of /product from 2.0 to 3.0, by '
        'graph:/product.',
    ]
