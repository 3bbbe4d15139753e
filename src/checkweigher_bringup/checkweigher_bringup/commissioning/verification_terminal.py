# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The operator of a verification at the terminal."""

from collections.abc import Sequence

from checkweigher_bringup.commissioning.static_guide import ask, show
from checkweigher_validation.verification.steps import Step

_UNFINISHED = 'the verification was done; what was recorded is in the bag'


class Terminal:
    """Ask by lines of the terminal; one that ends is a UserError."""

    def __init__(self) -> None:
        self._steps: Sequence[Step] = ()

    def begin(self, steps: Sequence[Step]) -> None:
        """Take the steps that will be asked for."""
        self._steps = steps

    def asked(self, number: int, step: Step) -> str:
        """Ask for a step; return why it is skipped."""
        show('')
        title = f'{number + 1}/{len(self._steps)} {step.name}'
        return ask(f'{title}: {step.to_do} (or type why it is skipped)', _UNFINISHED)

    def goes_on(self, number: int, found: str, *, passed: bool) -> bool:
        """Print the result; return whether to go on."""
        self.tell(f'{self._steps[number].name}, {found}')
        return passed or ask('Type r to make it again, or nothing to go on', _UNFINISHED) != 'r'

    def tell(self, text: str) -> None:
        """Print what has happened."""
        show('')
        print(text, flush=True)

    def show(self, text: str) -> None:
        """Show how it goes, where there is a terminal."""
        show(text)
