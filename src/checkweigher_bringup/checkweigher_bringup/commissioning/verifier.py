# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The verification by services: the operator is at the page.

The procedure is the one of the terminal. It runs in a thread of its own, and waits there for what
the operator answers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
import queue
import threading
from typing import Any, ClassVar

from checkweigher_msgs.srv import AnswerVerification, BeginVerification
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.machine_folder import own_folder
from checkweigher_bringup.commissioning.verification import report_on
from checkweigher_bringup.commissioning.verification_bags import Identity
from checkweigher_bringup.commissioning.verification_guide import (
    BrokenOffError,
    procedure_on_line,
)
from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.printable import one_line
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_core.whole_file import write_whole
from checkweigher_validation.verification.plan import (
    VERIFICATIONS,
    Plan,
    read_plan,
)
from checkweigher_validation.verification.steps import Step

_POLL_PERIOD = 0.1  # s
_END_PATIENCE = 20.0  # s, for the bag and the report of a procedure that ends with the node
_LINES = 100  # of a step, that are told
_LONGEST = 200  # characters of a reason
# What may be answered where something is asked.
_ANSWERS = {
    ProgressState.ASKING: (StepAnswer.MAKE, StepAnswer.SKIP),
    ProgressState.DECIDING: (StepAnswer.MAKE, StepAnswer.GO_ON),
}


@dataclass(frozen=True)
class VerifierParameters(Parameters):
    """Where plans and verifications are."""

    node: ClassVar[str] = 'verifier'

    folder: str = parameter('', 'folder with plans and verifications in it, must be given')
    audit_log: str = parameter('', 'audit log of the line, whose digest is in the report')


class RemoteOperator:
    """An operator who is told by records of `tell_all` how it goes, and answers from elsewhere."""

    def __init__(
        self, said: VerificationProgress, tell_all: Callable[[VerificationProgress], None]
    ) -> None:
        self._said = said
        self._tell_all = tell_all
        self._answers: queue.Queue[tuple[StepAnswer, str]] = queue.Queue()
        self._lock = threading.Lock()  # of what is said
        self._broken_off = threading.Event()

    # The thread of the procedure

    def begin(self, steps: Sequence[Step]) -> None:
        """Take the steps."""
        self._say(steps=tuple(step.name for step in steps), results=('',) * len(steps))

    def asked(self, number: int, step: Step) -> str:
        """Wait until the step is to be made, or skipped with the reason that is returned."""
        known = self._said
        # Lines of an attempt that came to nothing say why it is asked for again.
        lines = known.lines if known.step == number and not known.results[number] else ()
        answer, reason = self._ask(
            ProgressState.ASKING, step=number, text=step.to_do, lines=lines
        )  # fmt: skip
        if answer is StepAnswer.SKIP:
            self._say(results=self._results(number, f'skipped: {reason}'))
            return reason
        self._say(state=ProgressState.MAKING, text='', lines=())
        return ''

    def goes_on(self, number: int, found: str, *, passed: bool) -> bool:
        """Tell the result; wait for what to do about a step that failed."""
        self._say(results=self._results(number, found))
        if passed:
            return True
        answer, _ = self._ask(ProgressState.DECIDING, text=found)
        if answer is StepAnswer.MAKE:
            self._say(results=self._results(number, ''), lines=())
        return answer is StepAnswer.GO_ON

    def tell(self, text: str) -> None:
        """Tell what has happened in this step."""
        self._go_on()
        self._say(lines=(*self._said.lines, one_line(text))[-_LINES:])

    def show(self, text: str) -> None:
        """Tell how it goes."""
        self._go_on()
        if text != self._said.text:
            self._say(text=text)

    def finish(self) -> None:
        """Tell that the steps are over."""
        self._say(state=ProgressState.MAKING, text='the report is written')

    def end(self, text: str) -> None:
        """Tell how the procedure has ended."""
        self._say(state=ProgressState.IDLE, text=one_line(text))

    def _ask(self, state: ProgressState, **values: Any) -> tuple[StepAnswer, str]:
        self._say(state=state, question=self._said.question + 1, **values)
        while True:
            self._go_on()
            try:
                return self._answers.get(timeout=_POLL_PERIOD)
            except queue.Empty:
                continue

    def _go_on(self) -> None:
        if self._broken_off.is_set():
            raise BrokenOffError

    def _results(self, number: int, text: str) -> tuple[str, ...]:
        known = list(self._said.results)
        known[number] = one_line(text)
        return tuple(known)

    def _say(self, **values: Any) -> None:
        with self._lock:
            self._said = replace(self._said, **values)
            self._tell_all(self._said)

    # Other threads

    @property
    def ended(self) -> bool:
        """Whether the procedure has ended."""
        return self._said.state is ProgressState.IDLE

    def answer(self, question: int, answer: StepAnswer, reason: str) -> str:
        """Take an answer; return why it cannot be one, empty if it is."""
        with self._lock:
            said = self._said
            if question != said.question or said.state not in _ANSWERS:
                return 'this is not asked any more: look at what is'
            if answer not in _ANSWERS[said.state]:
                return 'a step that has failed is made again, or left as it is'
            if answer is StepAnswer.SKIP and not reason:
                return 'say why the step is skipped: the report says so'
            # The next one is to another question.
            self._said = replace(said, state=ProgressState.MAKING)
        self._answers.put((answer, reason))
        return ''

    def break_off(self) -> None:
        """Have the procedure end; what was made counts."""
        self._broken_off.set()


class VerifierNode(StageNode[VerifierParameters]):
    """Guide verifications, one at a time."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(VerifierParameters, read_only=True, overrides=overrides)
        try:
            self._folder = own_folder('verifier', self.parameters.folder)
        except ParameterError:
            self.destroy_node()
            raise
        self._operator: RemoteOperator | None = None
        self._thread: threading.Thread | None = None
        port = ports.VERIFICATION_PROGRESS
        # No output, which takes the lock of the process: whoever ends it waits for the thread.
        self._publisher = self.create_publisher(port.type, port.name, port.qos)
        self.create_service(BeginVerification, ports.BEGIN_VERIFICATION, self._on_begin)
        self.create_service(AnswerVerification, ports.ANSWER_VERIFICATION, self._on_answer)
        self.create_service(Trigger, ports.CANCEL_VERIFICATION, self._on_cancel)

    def start(self) -> None:
        """Tell where plans and verifications are."""
        super().start()
        self._tell(VerificationProgress(0, ProgressState.IDLE, folder=str(self._folder)))

    def _tell(self, said: VerificationProgress) -> None:
        said = replace(said, stamp=self.get_clock().now().nanoseconds)
        self._publisher.publish(to_message(ports.VERIFICATION_PROGRESS, said))

    # Services

    def _on_begin(self, request: Any, response: Any) -> Any:
        if self._operator is not None and not self._operator.ended:
            response.message = f'busy: a verification goes on; call {ports.CANCEL_VERIFICATION}'
            return response
        try:
            plan = read_plan(request.plan)
        except ParameterError as error:
            response.message = f'the plan: {error}'
            return response
        name = f'{datetime.now(UTC):%Y%m%dT%H%M%SZ}'
        said = VerificationProgress(
            0, ProgressState.MAKING, folder=str(self._folder), name=name, text='it begins'
        )  # fmt: skip
        self._operator = RemoteOperator(said, self._tell)
        self._tell(said)
        self._thread = threading.Thread(
            target=self._make, args=(plan, request.plan, name, self._operator), daemon=True
        )
        self._thread.start()
        response.success, response.message = True, f'verification {name} has begun'
        return response

    def _on_answer(self, request: Any, response: Any) -> Any:
        if self._operator is None or self._operator.ended:
            response.message = f'no verification goes on; call {ports.BEGIN_VERIFICATION}'
        elif request.answer not in tuple(StepAnswer):
            response.message = f'{request.answer}: is no answer'
        else:
            reason = one_line(request.reason.strip(), _LONGEST)
            answer = StepAnswer(request.answer)
            response.message = self._operator.answer(request.question, answer, reason)
        response.success = not response.message
        return response

    def _on_cancel(self, request: Any, response: Any) -> Any:
        """Break the procedure off."""
        response.success, response.message = True, 'nothing is under way'
        if self._operator is not None and not self._operator.ended:
            self._operator.break_off()
            response.message = 'it ends; its report has the steps that were made'
        return response

    # The procedure

    def _make(self, plan: Plan, text: str, name: str, operator: RemoteOperator) -> None:
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
            verdict = report_on(make, folder, audit)
            operator.end(f'{name}: {verdict}')
            self.get_logger().info(f'verification {name}: {verdict}')
        except Exception as error:  # of the line, the disk or the log; the node lives on
            operator.end(f'{name}: not made: {error}')
            self.warn(f'verification {name}: {type(error).__name__}: {error}')

    def shut_down(self) -> None:
        """Break off what is under way."""
        if self._operator is not None:
            self._operator.break_off()

    def destroy_node(self) -> None:
        """Wait for the bag and the report first."""
        thread = getattr(self, '_thread', None)
        if thread is not None:
            thread.join(_END_PATIENCE)
        super().destroy_node()


main = partial(run, VerifierNode)

if __name__ == '__main__':
    main()
