# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Operator of a verification, to whom the procedure in another thread shows its progress."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
import queue
import threading
from typing import Any

from checkweigher_bringup.errors import UserError
from checkweigher_core.printable import one_line
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress
from checkweigher_validation.verification.steps import Step

# Answers that are allowed in each state.
_ANSWERS = {
    ProgressState.ASKING: (StepAnswer.MAKE, StepAnswer.SKIP),
    ProgressState.DECIDING: (StepAnswer.MAKE, StepAnswer.GO_ON),
}
_POLL_PERIOD = 0.1  # s
_LINES = 100  # maximum number of published lines of text on the current step


class BrokenOffError(Exception):
    """Raised in the thread of the procedure if the operator cancels the procedure."""


class Operator:
    """Operator at the page or at the terminal, who sees the published progress and answers.

    `progress` is the initial progress. `publish` is called with the new progress after each change.
    After `break_off`, `tell`, `show` and each method that waits for an answer raise
    `BrokenOffError`.
    """

    def __init__(
        self, progress: VerificationProgress, publish: Callable[[VerificationProgress], object]
    ) -> None:
        self._progress = progress
        self._publish = publish
        self._answers: queue.Queue[tuple[StepAnswer, str]] = queue.Queue()
        self._lock = threading.Lock()  # guards `_progress`
        self._broken_off = threading.Event()

    # Methods for the thread of the procedure

    def begin(self, steps: Sequence[Step]) -> None:
        """Publish the steps of the procedure."""
        self._change(steps=tuple(step.name for step in steps), results=('',) * len(steps))

    def asked(self, number: int, step: Step) -> str:
        """Ask the operator to do a step, and wait for the answer.

        Returns the reason for skipping the step, or '' if the operator does the step.
        """
        known = self._progress
        # Keep the lines of a failed attempt, because they explain why the step is repeated.
        lines = known.lines if known.step == number and not known.results[number] else ()
        answer, reason = self._ask(ProgressState.ASKING, step=number, text=step.to_do, lines=lines)
        if answer is StepAnswer.SKIP:
            self._set_result(number, f'skipped: {reason}')
            return reason
        self.start(number)
        return ''

    def start(self, number: int) -> None:
        """Publish that a step is being made."""
        self._change(state=ProgressState.MAKING, step=number, text='in progress', lines=())

    def goes_on(self, number: int, found: str, *, passed: bool) -> bool:
        """Publish the result of a step. If the step failed, ask whether it must be repeated.

        Returns False if the step must be repeated, otherwise True.
        """
        self._set_result(number, found)
        if passed:
            return True
        answer, _ = self._ask(ProgressState.DECIDING, text=found)
        if answer is StepAnswer.MAKE:
            self._set_result(number, '', lines=())
        return answer is StepAnswer.GO_ON

    def tell(self, text: str) -> None:
        """Publish the text of an event in the present step, below the texts of earlier events.

        Only the latest `_LINES` texts are published.
        """
        self._check_continues()
        self._change(lines=(*self._progress.lines, one_line(text))[-_LINES:])

    def show(self, text: str) -> None:
        """Publish `text` as the state of the measurement, unless it is already published."""
        self._check_continues()
        if text != self._progress.text:
            self._change(text=text)

    def finish(self) -> None:
        """Publish that the steps have ended, and that the report is being written."""
        self._change(state=ProgressState.MAKING, text='the report is being written')

    def end(self, text: str, departures: Iterable[str] = ()) -> None:
        """Publish the end of the procedure.

        `text` contains the verdict or the error. The `departures` replace the texts of events.
        """
        lines = tuple(map(one_line, departures))[:_LINES]
        self._change(state=ProgressState.IDLE, text=one_line(text), lines=lines)

    def _ask(self, state: ProgressState, **values: Any) -> tuple[StepAnswer, str]:
        self._change(state=state, question=self._progress.question + 1, **values)
        while True:
            self._check_continues()
            with suppress(queue.Empty):
                return self._answers.get(timeout=_POLL_PERIOD)

    def _check_continues(self) -> None:
        if self._broken_off.is_set():
            raise BrokenOffError

    def _set_result(self, number: int, text: str, **values: Any) -> None:
        known = self._progress.results
        self._change(results=(*known[:number], one_line(text), *known[number + 1 :]), **values)

    def _change(self, **values: Any) -> None:
        with self._lock:
            self._progress = replace(self._progress, **values)
            self._publish(self._progress)

    # Methods for other threads

    @property
    def ended(self) -> bool:
        """True if the procedure has ended."""
        return self._progress.state is ProgressState.IDLE

    def answer(self, question: int, answer: StepAnswer, reason: str) -> None:
        """Accept the answer to the question with the number `question`.

        `reason` is the reason for skipping the step, and is not used for other answers.

        Raises `UserError` if the question is no longer open, if the answer is not allowed, or if
        the reason for skipping a step is missing.
        """
        with self._lock:
            now = self._progress
            if question != now.question or now.state not in _ANSWERS:
                raise UserError('this question is no longer open; answer the present question')
            if answer not in _ANSWERS[now.state]:
                raise UserError('this answer does not fit; repeat the failed step, or continue')
            if answer is StepAnswer.SKIP and not reason:
                raise UserError('say why the step is skipped; the report contains the reason')
            # Change the state, so that further answers to this question are refused.
            self._progress = replace(now, state=ProgressState.MAKING)
        self._answers.put((answer, reason))

    def break_off(self) -> None:
        """Request the end of the procedure. The report contains the steps so far.

        The thread of the procedure ends the steps when it next asks the operator or publishes a
        text.
        """
        self._broken_off.set()
