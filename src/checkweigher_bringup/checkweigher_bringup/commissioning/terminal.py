# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Questions at the terminal to a technician, or to the operator of a verification."""

from collections.abc import Callable, Sequence
import sys

from checkweigher_bringup.errors import UserError
from checkweigher_core.records import ProgressState, StepAnswer, VerificationProgress

_UNFINISHED = 'the verification was complete; the bag contains the steps so far'


def ask(text: str, unfinished: str = 'the calibration was done: nothing was written') -> str:
    """Print a request to the user on stderr, wait for Enter, and return the text that was typed.

    If the standard input ends, `UserError` is raised with a message that ends with `unfinished`.
    """
    print(f'{text}, then press Enter ', end='', file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise UserError(f'the input ended before {unfinished}')
    if not sys.stdin.isatty():
        print(file=sys.stderr)
    return answer.strip()


def show(text: str) -> None:
    """Replace the text in the last line of the terminal, if stderr is a terminal."""
    if sys.stderr.isatty():
        print(f'\r\x1b[K{text}', end='', file=sys.stderr, flush=True)


def tell(text: str) -> None:
    """Print a line about an event, which replaces the text that `show` has printed."""
    show('')
    print(text, flush=True)


class StepsAtTerminal:
    """Terminal of the operator of a verification.

    The function `answer` is called with the number of a question, the answer, and the reason for
    skipping the step, which is empty if the step is not skipped. The function must raise
    `UserError` if the question is no longer open; the message is then printed.
    """

    def __init__(self, answer: Callable[[int, StepAnswer, str], None]) -> None:
        self._answer = answer
        self._shown = VerificationProgress(0, ProgressState.IDLE)

    def follow(self, now: VerificationProgress) -> None:
        """Print the new results and lines of the progress, and ask the operator any new question.

        Raises `UserError` if the standard input ends.
        """
        before, self._shown = self._shown, now
        for number, (step, result) in enumerate(zip(now.steps, now.results, strict=True)):
            if result and before.results[number : number + 1] != (result,):
                tell(f'{step}, {result}')
        for line in _new(before.lines, now.lines):
            tell(line)
        if now.question != before.question:
            self._ask(now)
        elif now.state is ProgressState.MAKING:
            show(now.text)

    def _ask(self, now: VerificationProgress) -> None:
        show('')
        answer, reason = StepAnswer.MAKE, ''
        if now.state is ProgressState.ASKING:
            title = f'{now.step + 1}/{len(now.steps)} {now.steps[now.step]}'
            reason = ask(f'{title}: {now.text} (or type why it is skipped)', _UNFINISHED)
            answer = StepAnswer.SKIP if reason else StepAnswer.MAKE
        elif ask('Type r to repeat the step, or nothing to go on', _UNFINISHED) != 'r':
            answer = StepAnswer.GO_ON
        try:
            self._answer(now.question, answer, reason)
        except UserError as error:  # another operator has answered at the page
            tell(str(error))


def _new(before: Sequence[str], now: Sequence[str]) -> Sequence[str]:
    """Return the lines at the end of `now` that are not in `before`.

    `now` may lack the first lines of `before`, because the number of published lines is limited.
    """
    sizes = range(min(len(before), len(now)), 0, -1)
    same = next((size for size in sizes if before[-size:] == now[:size]), 0)
    return now[same:]
