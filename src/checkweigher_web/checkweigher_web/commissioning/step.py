# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Base class of the commissioning steps."""

from abc import ABC, abstractmethod
import asyncio
from collections.abc import Awaitable, Callable
from typing import ClassVar, NamedTuple

from nicegui import background_tasks

from checkweigher_web.access.users import Role
from checkweigher_web.languages.language import Text
from checkweigher_web.work.dialogs import Action, Desk
from checkweigher_web.work.services import LaneServices, Outcome

_POLL_PERIOD = 0.05  # s


class Standing(NamedTuple):
    """State of a step: whether the step is done, and a text on its result or on missing parts.

    `text` is English, and can be translated if it is a `Text`.
    """

    is_done: bool
    text: str


class Choice(NamedTuple):
    """Button of a step: its label, its function, and whether it can be pressed now."""

    label: Text
    press: Callable[[], Awaitable[object]]
    is_open: bool = True


class Step(ABC):
    """Commissioning step with its own panel.

    `title` is the name of the step, and `to_do` the instruction to the user. `tell` shows an
    outcome, and `reason` returns the reason that the user has entered.
    """

    title: ClassVar[Text]
    to_do: ClassVar[Text]

    def __init__(
        self,
        desk: Desk,
        services: LaneServices,
        tell: Callable[[Outcome], object],
        reason: Callable[[], str],
    ) -> None:
        self.desk = desk
        self.services = services
        self.lane, self.say = desk.lane, desk.say
        self.tell = tell
        self._reason = reason
        self._build()

    @abstractmethod
    def _build(self) -> None:
        """Add the elements of the step to its panel."""

    @abstractmethod
    def standing(self) -> Standing:
        """Return the state of the step."""

    def request(self) -> str:
        """Return what the user must do now, or the progress, to be shown beside the buttons.

        Returns '' if there is nothing to show. The text is English, and can be translated if it is
        a `Text`.
        """
        return ''

    @abstractmethod
    def primary(self) -> Choice:
        """Return the button for the next action of the step."""

    def others(self) -> tuple[Choice, ...]:
        """Return the other buttons of the step.

        A step must always return the same number of buttons, because the page creates the buttons
        only once.
        """
        return ()

    @abstractmethod
    async def update(self) -> None:
        """Show the present state in the elements of the step."""

    async def perform(self, what: str, action: Action) -> bool:
        """Perform an action for a technician, show its outcome, and return whether it was done.

        `what` is the name of the action in the audit log.
        """
        outcome = await self.desk.perform(Role.TECHNICIAN, what, action, self._reason())
        self.tell(outcome)
        return outcome.done

    async def begin(self, what: str, action: Action, name: str) -> None:
        """Begin `action`, which performs the ROS action `name`, in a separate asyncio task.

        The task continues after the user leaves the page. Returns when the action has begun, has
        ended, or was refused.
        """
        task = background_tasks.create(self.perform(what, action))
        while not (task.done() or name in self.services.feedback):
            await asyncio.sleep(_POLL_PERIOD)
