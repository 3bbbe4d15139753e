# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How late outputs were switched."""

import pytest

from checkweigher_driver.line_io.rejector.switching import Levels, Switches, SwitchTiming

MS = 1_000_000
REST = Levels(False, False, False, (False, False))
REJECT, PERMIT = REST._replace(reject=True), REST._replace(permit=True)
STATION = REST._replace(stations=(False, True))


@pytest.mark.parametrize(
    ('before', 'after', 'due', 'late'),
    [
        (REST, REJECT, Switches(reject=0), 'the rejector was 13 ms late; look behind it'),
        (REJECT, REST, Switches(reject=0), ''),  # longer than it should
        (REST, REJECT, Switches(reject=12 * MS), ''),  # at once, not at a time that was due
        (REST, STATION, Switches(station=0), 'a station was 13 ms late; look behind it'),
        (STATION, REST, Switches(station=0), ''),
        (PERMIT, REST, Switches(permit=0), 'the end of a permit was 13 ms late; look behind it'),
        (REST, PERMIT, Switches(permit=0), ''),
    ],
)
def test_a_late_switch_matters_where_a_product_can_have_passed(before, after, due, late):
    timing = SwitchTiming(late_tolerance=10 * MS)
    assert ''.join(timing.add(before, after, due, 11 * MS, 13 * MS)) == late
    assert timing.add(before, after, due, 0, 10 * MS) == []


def test_the_errors_of_the_rejector_are_counted():
    timing = SwitchTiming(late_tolerance=10 * MS)
    for begun, done in ((MS, 3 * MS), (5 * MS, 7 * MS)):
        timing.add(REST, REJECT, Switches(reject=0), begun, done)
    assert list(timing.figures.values()) == [2, 4, 6, 1]
