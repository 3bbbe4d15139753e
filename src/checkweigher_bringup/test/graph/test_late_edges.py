# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Edges that are held up on their way to the reject node: the products go on."""

import time

from reject_line import RejectLine

from checkweigher_bringup.spinning import Spinner

LANE = 'late_edges'


def test_an_item_whose_edges_come_after_its_reject_time_is_late(spinner: Spinner):
    # 4 s behind the outfeed eye. Item 1 is judged after 0.1 s, on a busy machine later.
    line = RejectLine(spinner, rejector_distance=2.0, verdict_margin=3.9)
    line.pass_item(1)
    assert not line.verdict().late
    time.sleep(5.5)  # item 2 passes 1 s after item 1; its edges do not
    line.pass_item(2)
    line.weigh(2)
    verdict = line.verdict()
    assert (verdict.item_id, verdict.late) == (2, True)
