# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator of a verification at the terminal."""

from collections.abc import Sequence

from checkweigher_bringup.commissioning.static_guide import ask, show
from checkweigher_validation.verification.steps import Step

_UNFINISHED = 'the verification was done; what was recorded is in the bag'


class Terminal:
    """Operator at the terminal; the end of the input raises UserError."""

    def __init__(self) -> None:
        self._steps: Sequence[Step] = ()

    def begin(self, steps: Sequence[Step]) -> None:
        """Set the steps of the procedure."""
        self._steps = steps

    def asked(self, number: int, step: Step) -> str:
        """Ask for a step; return the reason to skip it, if any."""
        show('')
        title = f'{number + 1}/{len(self._steps)} {step.name}'
        return ask(f'{title}: {step.to_do} (or type why it is skipped)', _UNFINISHED)

    def goes_on(self, number: int, found: str, *, passed: bool) -> bool:
        """Print the result; return whether to go on."""
        self.tell(f'{self._steps[number].name}, {found}')
        return passed or ask('Type r to make it again, or nothing to go on', _UNFINISHED) != 'r'

    def tell(self, text: str) -> None:
        """Print an event."""
        show('')
        print(text, flush=True)

    def show(self, text: str) -> None:
        """Show the state of the measurement, on a terminal."""
        show(text)
