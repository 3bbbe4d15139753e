# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The verdicts that a line should give: one for each item, and those of the offline path."""

from dataclasses import asdict
import json
import queue
from typing import Any

from checkweigher_msgs.msg import Verdict
from lines import weigh_all

from checkweigher_core.recording import Recording
from checkweigher_core.ros.conversion import stamp_from


def entered(edges: 'queue.SimpleQueue[Any]') -> list[int]:
    """Return t1 of all items whose edges were heard, in order of entry."""
    found = []
    while not edges.empty():
        _, edge = edges.get()
        if edge.eye == edge.INFEED and edge.blocked:
            found.append(stamp_from(edge.header.stamp))
    return found


def assert_one_verdict_each(edges: 'queue.SimpleQueue[Any]', found: list[Verdict]) -> None:
    """Check that all items from the first one to the last have one verdict, under one number."""
    starts = [stamp_from(verdict.t1) for verdict in found]
    assert sorted(starts) == [t1 for t1 in entered(edges) if min(starts) <= t1 <= max(starts)]
    assert len({verdict.item_id for verdict in found}) == len(found)


def offline_verdicts(recording: Recording) -> list[dict[str, Any]]:
    """Return the verdicts on a recording without the graph, as a witness tells them."""
    return [json.loads(json.dumps(asdict(w.verdict))) for w in weigh_all(recording)]
