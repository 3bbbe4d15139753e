# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The maker of a topic, told from strangers that publish there beside it.

DDS lists a publisher before it hands on the first message of it, and counts all that it has ever
connected with a subscription: one that has gone again shows in that count.
"""

from collections.abc import Mapping
import time
from typing import Any

from rclpy.node import Node

from checkweigher_dsp.ros.graph.hosts import host_of
from checkweigher_dsp.ros.graph.place import PARTICIPANT, is_held

_NAMING_TIME = 0.02  # s, in which DDS finds the name of a node after its endpoints
ANY = '*'  # allowed: every publisher

_Listed = Mapping[bytes, Any]  # endpoints by their gid


class ForeignPublisherError(ValueError):
    """A message that may be a stranger's."""


class Makers:
    """Watch of who publishes a topic.

    A node of the line on this computer is known by its place. Without one it is known by its name,
    if only one has that name: a node on another computer, or of a line that is not ours. What is
    not made by a stage may come from any node that is alone, such as a player of bags. All others
    are strangers, but for those that the node allows.

    Parameters
    ----------
    node : Node
        The node that takes or makes the topic.
    topic : str
        Full name.
    maker : str
        Name of the node of the line that makes it.
    stage : bool
        Whether only that node may.
    allowed : callable
        Returns the full names of further publishers, or `ANY`.
    mangled : bool
        Whether `topic` is a name of ROS, else one of DDS, such as that of the answers of a service.

    Attributes
    ----------
    strangers : tuple of str
        Full names of the strangers at the last look.
    hosts : frozenset of bytes
        Hosts of the others at the last look, see `host_of`.
    present : bool
        Whether the maker, or a node that is allowed, was there at the last look.
    passed : float
        When one has come and gone between two looks, s of the monotonic clock.
    """

    def __init__(
        self, node: Node, topic: str, maker: str, allowed: Any, *, stage: bool,
        mangled: bool = True,
    ) -> None:  # fmt: skip
        self._node = node
        self._topic = topic
        self._maker = f'{node.get_namespace().rstrip("/")}/{maker}'
        self._allowed = allowed
        self._stage = stage
        self._mangled = mangled
        self._domain = int(node.context.get_domain_id())
        self.strangers: tuple[str, ...] = ()
        self.hosts: frozenset[bytes] = frozenset()
        self.present = False
        self.passed = -float('inf')
        self._proved: set[bytes] = set()  # gids of the maker, also of one that has died since
        self._alone = b''  # gid of what is taken for the maker
        self._matched: Any = None  # the last count of connections
        self._watching = False
        self._listed: set[bytes] = set()
        self._seen = self._surplus = 0  # publishers in all: in the list, and in the count besides
        self._doubted_until = 0  # ns of the system clock

    @property
    def held(self) -> bool:
        """Whether the maker runs on this computer, before the graph lists it as well."""
        return is_held(self._domain, self._maker)

    def watch(self, *, watching: bool = True) -> None:
        """Begin to count the publishers that a new subscription connects, or let go of it."""
        self._watching, self._matched = watching, None
        self._listed, self._seen, self._surplus = set(), 0, 0

    def matched(self, status: Any) -> None:
        """Take how many publishers the subscription has connected, from its event.

        The executor calls events before messages.
        """
        self._matched = status

    def doubts(self, received: int) -> bool:
        """Return whether a message that came at `received`, ns, may be that of a stranger."""
        if not self._watching:
            return False
        self.look()
        # DDS counts a connection after it has made it: the list knows before, the count afterwards.
        passed = self._matched is not None and self._count_passed(self._matched)
        if passed:
            self.passed = time.monotonic()
        if passed:
            self._doubted_until = time.time_ns()
        if time.time_ns() < self._doubted_until:
            self._doubted_until = 0  # the clock was set back
        return received <= self._doubted_until

    def look(self) -> None:
        """Read who publishes now."""
        listed = self._find()
        if any(_nameless(each) for gid, each in listed.items() if gid not in self._listed):
            time.sleep(_NAMING_TIME)
            listed = self._find()
        self._seen += len(listed.keys() - self._listed)
        self._listed = set(listed)
        own = self._own(listed)
        allowed = self._allowed()
        others = {gid: full_name(each) for gid, each in listed.items() if gid not in own}
        foreign = {} if ANY in allowed else {g: n for g, n in others.items() if n not in allowed}
        strange = list(foreign.values())
        self.hosts = frozenset(host_of(gid) for gid in listed if gid not in foreign)
        if strange or self.strangers:  # what one that has gone since said last may be yet to come
            self._doubted_until = time.time_ns()
        self.strangers = tuple(sorted(set(strange)))
        self.present = len(strange) < len(listed)

    def _find(self) -> _Listed:
        find = self._node.get_publishers_info_by_topic
        return {bytes(e.endpoint_gid): e for e in find(self._topic, no_mangle=not self._mangled)}

    def _own(self, listed: _Listed) -> set[bytes]:
        """Return the gids of the maker."""
        held = is_held(self._domain, self._maker)
        self._proved &= listed.keys()
        if held:
            self._proved |= {
                gid
                for gid, each in listed.items()
                if (full_name(each) == self._maker or _nameless(each))
                and is_held(self._domain, self._maker, gid[:PARTICIPANT])
            }
        # One that was killed is listed for a while, and sends nothing more.
        if held or self._proved:
            self._alone = b''
            return self._proved
        if self._alone not in listed:
            named = [gid for gid, each in listed.items() if full_name(each) == self._maker]
            mine = named or ([] if self._stage else list(listed))
            self._alone = mine[0] if len(mine) == 1 else b''
        return {self._alone}

    def _count_passed(self, status: Any) -> bool:
        """Return whether a publisher has been connected that was never in the list."""
        more = status.total_count - self._seen - self._surplus
        if more > 0 or status.current_count == len(self._listed):
            self._surplus += more
        return more > 0 and ANY not in self._allowed() and (self._stage or bool(self._proved))


def full_name(endpoint: Any) -> str:
    """Return the full name of the node of an endpoint."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'


def _nameless(endpoint: Any) -> bool:
    return str(endpoint.node_name) == '_NODE_NAME_UNKNOWN_'
