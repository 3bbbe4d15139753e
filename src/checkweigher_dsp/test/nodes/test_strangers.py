# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which publishers of a topic are strangers."""

import pytest

from checkweigher_core.health.findings import Level
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_dsp.nodes.strangers import StrangerWatch, strangers

MAKER = '/lane1/identifier'


@pytest.mark.parametrize(
    ('publishers', 'found'),
    [
        ([], []),
        ([MAKER], []),
        ([MAKER, MAKER], []),  # it was killed and started again
        (['/lane1/my_identifier'], []),  # in the place of the maker
        ([MAKER, '/stranger'], ['/stranger']),
        ([MAKER, MAKER, '/stranger', '/stranger', '/lane2/identifier'],
         ['/lane2/identifier', '/stranger']),
        (['/one', '/other'], ['/one', '/other']),
    ],
)  # fmt: skip
def test_strangers_are_the_names_beside_the_maker(publishers, found):
    assert strangers(publishers, MAKER) == found


def test_a_stranger_is_named_with_its_topics_while_it_is_there(process):
    reject, identifier, segmenter, stranger = map(
        PortNode, ('reject', 'identifier', 'segmenter', 'stranger')
    )
    for node in (reject, identifier, segmenter, stranger):
        process.spinner.add(node)
    identifier.output(ports.MASS_ESTIMATE)
    segmenter.output(ports.WEIGH_WINDOW)
    reject.output(ports.EXTERNAL_REJECT)
    stranger.output(ports.EXTERNAL_REJECT)  # as any node may
    watch = StrangerWatch(reject)

    publishers = [stranger.output(p).publisher for p in (ports.MASS_ESTIMATE, ports.WEIGH_WINDOW)]
    text = '/stranger publishes /weigh_window, /mass_estimate'
    process.wait_for(lambda: watch.look() == text)
    assert (watch.finding().level, watch.finding().text) == (Level.ERROR, text)
    for publisher in publishers:
        stranger.destroy_publisher(publisher)
    process.wait_for(lambda: watch.look() == '')
    assert watch.finding().level == Level.OK
