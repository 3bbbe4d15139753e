# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The services of a lane, called from the page, and what persons did in the audit log."""

import asyncio
from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
import json
from pathlib import Path
import time
from typing import Any

from checkweigher_msgs.msg import DynamicSetting
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.client import Client

from checkweigher_core.changes import PERSON
from checkweigher_core.printable import one_line
from checkweigher_core.records import PerformanceTest, ProductOnLine, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.services import (
    LIFE_CYCLE_NODES,
    OF_MACHINE,
    PAGE_WORK,
    SERVICES,
    SETTER,
    changes_line,
)
from checkweigher_core.ros.spinner import Spinner

_DISCOVERY = 3.0  # s, for a service to be found
_PATIENCE = 120.0  # s, for an answer: a load may take half a minute to come to rest
_LOOK_PERIOD = 1.0  # s

# The node that has a service, by its name in the lane.
_SERVICES: dict[str, tuple[Any, str]] = {
    **{
        each.name: (ports.interface(each.kind), each.server)
        for each in SERVICES
        if PAGE_WORK in each.callers
    },
    **{
        f'{node}/{name}': (kind, node)
        for node in LIFE_CYCLE_NODES
        for name, kind in (('get_state', GetState), ('change_state', ChangeState))
    },
    **{
        f'{node}/get_parameters': (GetParameters, node)
        for node in ('driver', 'product', *ports.STAGES)
    },
    **{
        f'{node}/{SETTER}': (SetParametersAtomically, node)
        for node in ('driver', 'segmenter', 'reject', 'product', *OF_MACHINE)
    },
}


class RefusedError(Exception):
    """What was asked was not done; the message says why, in words."""


@dataclass(frozen=True)
class Person:
    """Who acts, and from where."""

    name: str
    address: str


@dataclass(frozen=True)
class Outcome:
    """What came of an action, in words."""

    done: bool
    text: str


# Who acts in the task that runs, and why.
_ACTING: ContextVar[tuple[Person, str] | None] = ContextVar('acting', default=None)


class LaneServices(PortNode):
    """Clients of the services of a lane, for the thread of the page."""

    def __init__(self, lane: str) -> None:
        super().__init__('page_work', namespace=f'/{lane}')
        self._by_name: dict[str, Client] = {
            name: self.create_client(kind, name) for name, (kind, _) in _SERVICES.items()
        }
        self._has_log = False
        self.readings: list[str] = []  # loads that were read for a calibration
        self.setting: DynamicSetting | None = None  # how far it is, once it was heard
        self.test: PerformanceTest | None = None
        self.verification: VerificationProgress | None = None
        self.product: ProductOnLine | None = None  # by which items are judged
        self.batch_folder: Path | None = None  # once somebody has asked for it
        for name, port in (
            ('setting', ports.DYNAMIC_SETTING), ('test', ports.PERFORMANCE_TEST),
            ('verification', ports.VERIFICATION_PROGRESS), ('product', ports.PRODUCT_IN_USE),
        ):  # fmt: skip
            self.subscribe(port, partial(setattr, self, name), qos=port.qos)

    @property
    def acting(self) -> tuple[Person, str] | None:
        """Who acts in the task that runs, and why."""
        return _ACTING.get()

    async def call(self, name: str, **values: Any) -> Any:
        """Return the answer of a service; `RefusedError` without one, or if it says no."""
        client, (kind, node) = await self.found(name), _SERVICES[name]
        if changes_line(name):  # the log has to know who does
            await self._tell_who(_ACTING.get(), [name])
        answer = await self._answer(client, kind.Request(**values), node)
        if not getattr(answer, 'success', True):
            raise RefusedError(getattr(answer, 'message', '') or f'{node} refused; see Diagnostics')
        return answer

    async def message(self, name: str, **values: Any) -> str:
        """Return the message in the answer of a service; see `call`."""
        return str((await self.call(name, **values)).message)

    async def found(self, name: str) -> Client:
        """Return the client of a service that is there; `RefusedError` if it is not."""
        client, (_, node) = self._by_name[name], _SERVICES[name]
        deadline = time.monotonic() + _DISCOVERY
        while not client.service_is_ready():
            if time.monotonic() > deadline:
                raise RefusedError(f'the node {node} does not run in this lane')
            await asyncio.sleep(0.05)
        return client

    async def _answer(self, client: Client, request: Any, node: str) -> Any:
        loop, came, asked = asyncio.get_running_loop(), asyncio.Event(), time.monotonic()
        future = client.call_async(request)
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(came.set))
        while True:
            try:
                await asyncio.wait_for(came.wait(), _LOOK_PERIOD)
                return future.result()
            except TimeoutError:
                gone = not client.service_is_ready()
                if gone or time.monotonic() - asked > _PATIENCE:
                    client.remove_pending_request(future)
                    why = 'ended before it answered' if gone else 'does not answer'
                    raise RefusedError(f'the node {node} {why}') from None

    async def act(
        self, person: Person, what: str, reason: str, action: Callable[[], Awaitable[str]]
    ) -> Outcome:
        """Do something for a person, written down before with its reason and after with its end.

        `action` returns what was done, or raises `RefusedError`; another failure is told of and
        written down, too. Without an audit log nothing is written; where a lane has had one,
        nothing is done without it.
        """
        why = f'; reason: {reason}' if reason else ''
        try:
            await self._note(person, f'{what}: asked from {person.address}{why}', reason)
        except RefusedError as error:
            return Outcome(False, f'nothing was done: not in the audit log: {error}')
        acting = _ACTING.set((person, reason))
        try:
            outcome, ending = Outcome(True, await action()), 'done'
        except RefusedError as error:
            outcome = Outcome(False, one_line(error))
            ending = f'refused: {outcome.text}'
        except Exception as error:  # a mistake in this program
            self.fail(error, what)
            ending = f'failed: {type(error).__name__}: {one_line(error)}'
            outcome = Outcome(False, f'it {ending}')
        finally:
            _ACTING.reset(acting)
        try:
            await self._tell_who((person, reason), [])
            await self._note(person, f'{what}: {ending}', reason)
        except RefusedError as error:
            return Outcome(
                outcome.done, f'{outcome.text}; its end is not in the audit log: {error}'
            )
        return outcome

    async def _note(self, person: Person, text: str, reason: str) -> None:
        if self._finds_log():
            await self._record(person, reason, new_value=json.dumps(one_line(text)))

    async def _tell_who(self, acting: tuple[Person, str] | None, services: list[str]) -> None:
        """Say which services a person is about to call; none when all is done."""
        if acting is not None and self._finds_log():
            await self._record(*acting, new_value='null', subjects=services)

    async def _record(self, person: Person, reason: str, **values: Any) -> None:
        named = {'subject': person.name, 'who': person.name, 'reason': one_line(reason)}
        await self.call(ports.RECORD_CHANGE, kind=PERSON, **named, **values)

    def _finds_log(self) -> bool:
        self._has_log = self._has_log or self._by_name[ports.RECORD_CHANGE].service_is_ready()
        return self._has_log


class Workshop:
    """The services of all lanes, each made when a person works there first."""

    def __init__(self, spinner: Spinner) -> None:
        self._spinner = spinner
        self._lanes: dict[str, LaneServices] = {}

    async def of(self, lane: str) -> LaneServices:
        """Return the services of a lane."""
        if lane not in self._lanes:
            self._lanes[lane] = LaneServices(lane)
            await asyncio.to_thread(self._spinner.add, self._lanes[lane])
        return self._lanes[lane]

    def known(self, lane: str) -> LaneServices | None:
        """Return the services of a lane where somebody has worked, None of another one."""
        return self._lanes.get(lane)
