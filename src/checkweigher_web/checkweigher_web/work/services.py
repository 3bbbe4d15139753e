# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Clients of the services and actions of a lane, with audit log entries on their users."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
import json
import math
from pathlib import Path
import time
from typing import Any, NamedTuple

from action_msgs.msg import GoalStatus
from action_msgs.srv import CancelGoal
from checkweigher_msgs.msg import DynamicSetting
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.action import ActionClient
from rclpy.client import Client
from rclpy.task import Future

from checkweigher_core.changes import PERSON, SIGNATURE
from checkweigher_core.printable import one_line
from checkweigher_core.records import LoadCell, PerformanceTest, ProductOnLine, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_core.ros.port_node import PortNode
from checkweigher_core.ros.services import (
    ACTIONS,
    LIFE_CYCLE_NODES,
    OF_MACHINE,
    PAGE_WORK,
    SERVICES,
    SETTER,
    changes_line,
)
from checkweigher_core.ros.spinner import Spinner
from checkweigher_web.languages.language import Text

# Maximum time in s until a service is discovered.
_DISCOVERY = 3.0
# Maximum time in s to wait for an answer. Some nodes answer only when a load is at rest.
_PATIENCE = 120.0
# Period in s of the check whether a server still runs.
_LOOK_PERIOD = 1.0

# Type of each service and the node that serves it, by the name of the service in the lane.
_SERVICES: dict[str, tuple[Any, str]] = {
    **{
        each.name: (ports.interface(each.kind), each.server)
        for each in SERVICES
        if PAGE_WORK in each.callers
    },
    **{f'{each.name}/_action/cancel_goal': (CancelGoal, each.server) for each in ACTIONS},
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
# Type of each action and the node that serves it, by the name of the action in the lane.
_ACTIONS = {each.name: (ports.interface(each.kind), each.server) for each in ACTIONS}
_FOLLOWED = {
    'setting': ports.DYNAMIC_SETTING,
    'test': ports.PERFORMANCE_TEST,
    'verification': ports.VERIFICATION_PROGRESS,
    'product': ports.PRODUCT_IN_USE,
}


class ActionRefusedError(Exception):
    """Raised if an action is refused, with the reason as the message."""

    @property
    def text(self) -> str:
        """Reason for the refusal, which is a `Text` if the page itself refuses the action."""
        return self.args[0] if isinstance(self.args[0], Text) else one_line(self.args[0])


@dataclass(frozen=True)
class Person:
    """Name of a user, and the address from which the user acts, for the audit log.

    `address` is the network address of the user's browser or of the MQTT broker, or 'OPC UA' for a
    user of the OPC UA gateway.
    """

    name: str
    address: str


@dataclass(frozen=True)
class Outcome:
    """Outcome of an action, and a text for the user, which is English unless it is a `Text`."""

    done: bool
    text: str


class LoadRead(NamedTuple):
    """Mass of a load by the calibration in use, and its standard error, both in kg."""

    load: Text  # name of the load for the user: its known mass, or 'empty belt'
    mass: float
    uncertainty: float


# User for whom the current asyncio task performs an action, and the reason that the user has given.
# The value is None if the task does not perform an action of a user.
ACTING: ContextVar[tuple[Person, str] | None] = ContextVar('acting', default=None)


class LaneServices(PortNode):
    """Clients of the services and actions of a lane.

    The clients may be used by only one thread: the thread of the page, or the thread of a gateway.

    Attributes
    ----------
    feedback : dict of str to message
        Latest feedback of each running action that the page has begun, by the name of the action.
    readings : list of LoadRead
        Readings of loads for the next calibration.
    uncertainties : dict of float to float
        Standard uncertainty in kg of each known mass that a user has read for a calibration, by the
        mass in kg.
    calibrated : Text or None
        Text on the latest calibration that the page has written, or None if it has written none.
    taken : LoadCell or None
        Load cell of the line when trained parameters were taken over last, or None if none were.
    plans : dict of str to str
        Text of the verification plan that each user edited last, by user name, or '' for a new plan
        that was not edited.
    setting, test, verification, product
        Latest message about the dynamic setting, the performance test, the verification and the
        product on the line, or None if no message has arrived.
    batch_folder : Path or None
        Folder of the batch reports, or None until a user has opened the list of reports.
    """

    def __init__(self, lane: str, name: str = PAGE_WORK) -> None:
        super().__init__(name, namespace=f'/{lane}')
        self._by_name: dict[str, Client] = {
            name: self.create_client(kind, name) for name, (kind, _) in _SERVICES.items()
        }
        self._action_clients = {
            name: ActionClient(self, kind, name) for name, (kind, _) in _ACTIONS.items()
        }
        self.feedback: dict[str, Any] = {}
        self._has_log = False
        self.readings: list[LoadRead] = []
        self.uncertainties: dict[float, float] = {}
        self.calibrated: Text | None = None
        self.taken: LoadCell | None = None
        self.plans: dict[str, str] = {}
        self.setting: DynamicSetting | None = None
        self.test: PerformanceTest | None = None
        self.verification: VerificationProgress | None = None
        self.product: ProductOnLine | None = None
        self.batch_folder: Path | None = None
        for name, port in _FOLLOWED.items():
            self.subscribe(port, partial(setattr, self, name), qos=port.qos)

    async def call(self, name: str, **values: Any) -> Any:
        """Call a service, and return its answer.

        `values` are the fields of the request. A call that changes the line is first announced to
        the node that writes the audit log, so that the entry on the change names the user in
        `ACTING`. Raises `ActionRefusedError` if the service refuses, or if its node does not run or
        does not answer.
        """
        client, (kind, node) = await self.found(name), _SERVICES[name]
        acting = ACTING.get()
        if acting is not None and changes_line(name):
            await self._note(acting, services=[name])
        answer = await self._answer(client, kind.Request(**values), node)
        if not getattr(answer, 'success', True):
            raise ActionRefusedError(
                getattr(answer, 'message', '') or Text('{node} refused; see Diagnostics', node=node)
            )
        return answer

    async def message(self, name: str, **values: Any) -> str:
        """Call a service as `call` does, and return the message in its answer."""
        return str((await self.call(name, **values)).message)

    async def do(self, name: str, *, may_end: bool = False, **values: Any) -> Any:
        """Perform the action `name` of a node, and return its result.

        `values` are the fields of the goal. Raises `ActionRefusedError` if the goal does not
        succeed, or if the node does not run or ends. If `may_end` is true, the result of a
        cancelled goal is also returned.
        """
        client, (kind, node) = self._action_clients[name], _ACTIONS[name]
        await _ready(client.server_is_ready, node)
        assert self.executor is not None
        # The executor sends the goal, so that rclpy registers the goal before an answer can arrive.
        goal = self.executor.create_task(self._follow, client, name, kind, values)
        try:
            answer = await self._awaited(goal, client.server_is_ready, node, math.inf)
        except ActionRefusedError:
            goal.cancel()
            raise
        ends = {GoalStatus.STATUS_SUCCEEDED, *([GoalStatus.STATUS_CANCELED] if may_end else [])}
        if answer is None or answer.status not in ends:
            raise ActionRefusedError((answer and answer.result.message) or Text('it was cancelled'))
        return answer.result

    async def _follow(
        self, client: ActionClient, name: str, kind: Any, values: dict[str, Any]
    ) -> Any:
        """Send a goal, store its feedback, and return its result, or None if it is refused."""

        def keep(message: Any) -> None:
            self.feedback[name] = message.feedback

        handle = await client.send_goal_async(kind.Goal(**values), keep)
        if handle.accepted:
            self.feedback.setdefault(name, kind.Feedback())
        try:
            return await handle.get_result_async() if handle.accepted else None
        finally:
            self.feedback.pop(name, None)

    async def cancel(self, name: str) -> str:
        """Cancel all goals of an action, and return a text for the user.

        Raises `ActionRefusedError` if the node of the action does not run or does not answer.
        """
        await self.call(f'{name}/_action/cancel_goal')
        return Text('it ends')

    async def found(self, name: str) -> Client:
        """Return the client of a service. Raises `ActionRefusedError` if its node does not run."""
        client, (_, node) = self._by_name[name], _SERVICES[name]
        await _ready(client.service_is_ready, node)
        return client

    async def _answer(self, client: Client, request: Any, node: str) -> Any:
        future = client.call_async(request)
        try:
            return await self._awaited(future, client.service_is_ready, node, _PATIENCE)
        except ActionRefusedError:
            client.remove_pending_request(future)
            raise

    async def _awaited(
        self, future: Future, is_ready: Callable[[], bool], node: str, patience: float
    ) -> Any:
        """Return the result of a future, which the server in `node` sets.

        Raises `ActionRefusedError` if no result arrives within `patience` s, or if the server ends.
        """
        loop, came, asked = asyncio.get_running_loop(), asyncio.Event(), time.monotonic()
        future.add_done_callback(lambda _: loop.call_soon_threadsafe(came.set))
        while True:
            try:
                await asyncio.wait_for(came.wait(), _LOOK_PERIOD)
                return future.result()
            except TimeoutError:
                gone = not is_ready()
                if gone or time.monotonic() - asked > patience:
                    text = Text('the node {node} does not answer', node=node)
                    if gone:
                        text = Text('the node {node} ended before it answered', node=node)
                    raise ActionRefusedError(text) from None

    async def act(
        self, person: Person, what: str, reason: str, action: Callable[[], Awaitable[str]]
    ) -> Outcome:
        """Perform an action for a user, with entries in the audit log before and after it.

        `action` returns a text on its outcome, or raises `ActionRefusedError`. Any other error is
        logged, and the outcome contains its message. A lane without an audit log gets no entries.
        If an existing audit log cannot be written, the action is not performed.
        """
        acting = person, reason
        why = f'; reason: {reason}' if reason else ''
        try:
            await self._note(acting, f'{what}: asked from {person.address}{why}')
        except ActionRefusedError as error:
            text = Text('nothing was done: not in the audit log: {error}', error=error.text)
            return Outcome(False, text)
        token = ACTING.set(acting)
        try:
            outcome, ending = Outcome(True, await action()), 'done'
        except ActionRefusedError as error:
            outcome = Outcome(False, error.text)
            ending = f'refused: {outcome.text}'
        except Exception as error:
            self.fail(error, what)
            failure = f'{type(error).__name__}: {one_line(error)}'
            ending = f'failed: {failure}'
            outcome = Outcome(False, Text('it failed: {failure}', failure=failure))
        finally:
            ACTING.reset(token)
        try:
            await self._note(acting)
            await self._note(acting, f'{what}: {ending}')
        except ActionRefusedError as error:
            text = Text(
                '{outcome}; its end is not in the audit log: {error}',
                outcome=outcome.text or Text('done'),
                error=error.text,
            )
            return Outcome(outcome.done, text)
        return outcome

    async def write_signature(self, subject: str, value: Mapping[str, str]) -> None:
        """Write a signature to the audit log in the name of the user in `ACTING`.

        `subject` is the subject of the entry, and `value` is the content of the signature. Raises
        `ActionRefusedError` if the entry cannot be written.
        """
        if (acting := ACTING.get()) is not None:
            await self._note(acting, services=[ports.RECORD_CHANGE])
        text = json.dumps(dict(value))
        await self.call(ports.RECORD_CHANGE, kind=SIGNATURE, subject=subject, new_value=text)

    async def _note(
        self, acting: tuple[Person, str], text: str | None = None, services: Sequence[str] = ()
    ) -> None:
        """Write an entry on a user to the audit log, or announce service calls if `text` is None.

        Does nothing if the lane has no audit log. The node that writes the audit log names the user
        in the entries on the changes that the announced services make. An announcement without
        services ends the earlier announcements.
        """
        self._has_log = self._has_log or self._by_name[ports.RECORD_CHANGE].service_is_ready()
        if not self._has_log:
            return
        person, reason = acting
        await self.call(
            ports.RECORD_CHANGE,
            kind=PERSON,
            subject=person.name,
            who=person.name,
            reason=one_line(reason),
            new_value=json.dumps(None if text is None else one_line(text)),
            subjects=list(services),
        )


async def _ready(is_ready: Callable[[], bool], node: str) -> None:
    """Wait until a server is discovered, or raise `ActionRefusedError` if its node does not run."""
    deadline = time.monotonic() + _DISCOVERY
    while not is_ready():
        if time.monotonic() > deadline:
            raise ActionRefusedError(Text('the node {node} does not run in this lane', node=node))
        await asyncio.sleep(0.05)


class Workshop:
    """`LaneServices` of the lanes on which users have worked, by the namespace of the lane."""

    def __init__(self, spinner: Spinner, name: str = PAGE_WORK) -> None:
        self._spinner, self._name = spinner, name
        self.lanes: dict[str, LaneServices] = {}

    async def of(self, lane: str) -> LaneServices:
        """Return the services of a lane. The first call adds their node to the executor."""
        if lane not in self.lanes:
            self.lanes[lane] = LaneServices(lane, self._name)
            await asyncio.to_thread(self._spinner.add, self.lanes[lane])
        return self.lanes[lane]
