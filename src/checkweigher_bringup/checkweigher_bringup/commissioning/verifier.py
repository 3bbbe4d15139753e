# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node that guides an operator at the page or at the terminal through a verification.

The procedure runs in a thread of its own, because it waits for the answers of the operator.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
import threading
from typing import Any, ClassVar

from checkweigher_msgs.action import RunVerification
from checkweigher_msgs.srv import AnswerVerification, BeginVerification
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.identity import Identity
from checkweigher_bringup.commissioning.machine_folder import own_folder
from checkweigher_bringup.commissioning.verification import note_result, report_on
from checkweigher_bringup.commissioning.verification_guide import procedure_on_line
from checkweigher_bringup.commissioning.verification_operator import Operator
from checkweigher_bringup.errors import UserError
from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.printable import one_line
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_core.whole_file import write_whole
from checkweigher_validation.verification.plan import VERIFICATIONS, Plan, read_plan

_END_PATIENCE = 20.0  # maximum time in s to complete the bag and the report when the node ends
_LONGEST = 200  # maximum number of characters of a reason for skipping a step


@dataclass(frozen=True)
class VerifierParameters(Parameters):
    """Parameters of the node that runs verifications."""

    node: ClassVar[str] = 'verifier'

    folder: str = parameter('', 'folder that contains plans/ and verifications/; must be given')
    audit_log: str = parameter(
        '', 'audit log of the line, whose digest the reports contain; empty for none'
    )


class VerifierNode(StageNode[VerifierParameters]):
    """Node that guides an operator through verifications, one at a time."""

    _thread: threading.Thread | None = None

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(VerifierParameters, read_only=True, overrides=overrides)
        self._folder = own_folder(self, self.parameters.folder)
        self._operator: Operator | None = None
        port = ports.VERIFICATION_PROGRESS
        # A plain publisher is used, because an `Output` would need the lock of the process. The
        # thread of the procedure must not wait for that lock, because a thread that holds it may be
        # waiting for the procedure.
        self._publisher = self.create_publisher(port.type, port.name, port.qos)
        self.create_action(RunVerification, ports.RUN_VERIFICATION, self._run, self._break_off)
        for kind, name, callback in (
            (BeginVerification, ports.BEGIN_VERIFICATION, self._begin_by_service),
            (AnswerVerification, ports.ANSWER_VERIFICATION, self._answer),
            (Trigger, ports.CANCEL_VERIFICATION, self._cancel_by_service),
        ):
            self.create_service(kind, name, callback)

    def start(self) -> None:
        """Publish the folder of plans and verifications, and that no verification is running."""
        super().start()
        self._publish(VerificationProgress(0, ProgressState.IDLE, folder=str(self._folder)))

    def _publish(self, progress: VerificationProgress) -> Any:
        """Publish the progress, which late subscribers also receive, and return the message."""
        progress = replace(progress, stamp=self.get_clock().now().nanoseconds)
        message = to_message(ports.VERIFICATION_PROGRESS, progress)
        self._publisher.publish(message)
        return message

    # Actions and services

    @property
    def _busy(self) -> Operator | None:
        """Operator of the current verification, or None if no verification is running."""
        return None if self._operator is None or self._operator.ended else self._operator

    async def _run(self, goal: Any, result: Any, tell: Callable[..., None]) -> None:
        result.message, result.folder = await self._begin(
            goal.plan, lambda progress: tell(progress=self._publish(progress))
        )
        if not result.folder:
            raise UserError(result.message)

    def _begin(self, text: str, publish: Callable[[VerificationProgress], object]) -> Future:
        """Begin a verification, and return a future.

        The result of the future is the verdict and the folder or, after a failure, the error and
        an empty text. Raises `UserError` if a verification is running or the plan is not valid.
        """
        if self._busy:
            raise UserError(f'busy: a verification is running; cancel {ports.RUN_VERIFICATION}')
        try:
            plan = read_plan(text)
        except ParameterError as error:
            raise UserError(f'the plan: {error}') from None
        name = f'{datetime.now(UTC):%Y%m%dT%H%M%SZ}'
        progress = VerificationProgress(
            0, ProgressState.MAKING, folder=str(self._folder), name=name, text='begins'
        )
        self._operator = Operator(progress, publish)
        publish(progress)
        ended = Future()
        # Without this call, a result that another thread sets would not wake the executor.
        ended.add_done_callback(lambda _: self.executor.wake())
        procedure = (plan, text, name, self._operator, ended)
        self._thread = threading.Thread(target=self._make, args=procedure, daemon=True)
        self._thread.start()
        return ended

    def _begin_by_service(self, request: Any, response: Any) -> str:
        self.warn_of(ports.BEGIN_VERIFICATION, ports.RUN_VERIFICATION)
        self._begin(request.plan, self._publish)
        return 'the verification has begun'

    def _answer(self, request: Any, response: Any) -> str:
        if (operator := self._busy) is None:
            raise UserError(f'no verification is running; begin {ports.RUN_VERIFICATION}')
        if request.answer not in tuple(StepAnswer):
            raise UserError(f'{request.answer}: is not a valid answer')
        reason = one_line(request.reason.strip(), _LONGEST)
        operator.answer(request.question, StepAnswer(request.answer), reason)
        return ''

    def _break_off(self) -> None:
        """Request the end of the current verification, if there is one.

        The report of this verification contains the completed steps.
        """
        if (operator := self._busy) is not None:
            operator.break_off()

    def _cancel_by_service(self, request: Any, response: Any) -> str:
        self.warn_of(ports.CANCEL_VERIFICATION, ports.RUN_VERIFICATION)
        if not self._busy:
            return 'nothing to cancel'
        self._break_off()
        return 'the verification ends; its report contains the completed steps'

    # The procedure

    def _make(self, plan: Plan, text: str, name: str, operator: Operator, ended: Future) -> None:
        folder = self._folder / VERIFICATIONS / name
        audit = Path(self.parameters.audit_log) if self.parameters.audit_log else None
        assert self.spinner is not None
        spinner = self.spinner

        def make(identity: Identity, bag: Path) -> None:
            write_whole(folder / 'plan.yaml', text)
            procedure_on_line(spinner, plan, text, identity, bag, operator)
            operator.finish()

        try:
            folder.parent.mkdir(exist_ok=True)
            verdict, departures = report_on(make, folder, audit)
            if audit is not None:
                verdict += note_result(self, folder, plan, verdict)
            operator.end(f'{name}: {verdict}', departures)
            self.get_logger().info(f'verification {name}: {verdict}')
            ended.set_result((verdict, str(folder)))
        except Exception as error:  # a failure of the line or of the disk must not end the node
            operator.end(f'{name}: failed: {error}')
            self.warn(f'verification {name}: {type(error).__name__}: {error}')
            ended.set_result((str(error), ''))

    def shut_down(self) -> None:
        """Request the end of the current procedure. `destroy_node` waits for the end."""
        if self._operator is not None:
            self._operator.break_off()

    def destroy_node(self) -> None:
        """Wait until the bag and the report are complete, and destroy the node.

        After `_END_PATIENCE` s, the node is destroyed even if the bag or the report is incomplete.
        """
        if self._thread is not None:
            self._thread.join(_END_PATIENCE)
        super().destroy_node()


main = partial(run, VerifierNode)

if __name__ == '__main__':
    main()
