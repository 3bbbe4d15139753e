# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lanes by the names of topics."""

import pytest

from checkweigher_core.ros.ports import DIAGNOSTICS, DRIVER_STATUS, PHOTO_EYES, RECORDED, VERDICT
from checkweigher_recording.bags.lanes import find_port, lane_prefix


@pytest.mark.parametrize(
    ('name', 'found'),
    [
        ('/verdict', ('', VERDICT)),
        ('verdict', ('', VERDICT)),
        ('/plant/lane1/photo_eyes', ('/plant/lane1', PHOTO_EYES)),
        ('/lane1/load_cell/status', ('/lane1', DRIVER_STATUS)),
        ('/diagnostics', ('', DIAGNOSTICS)),
        ('/lane1/diagnostics', None),
        ('/my_verdict', None),
        ('/scan', None),
    ],
)
def test_a_topic_is_that_of_a_port_below_a_namespace(name, found):
    assert find_port(name, RECORDED) == found


@pytest.mark.parametrize('namespace', ['plant/lane1', '/plant/lane1', 'plant//lane1/'])
def test_a_namespace_is_one_however_its_slashes_are_written(namespace):
    assert lane_prefix(namespace) == '/plant/lane1'


@pytest.mark.parametrize('namespace', ['', '/'])
def test_no_namespace_has_no_prefix(namespace):
    assert lane_prefix(namespace) == ''
