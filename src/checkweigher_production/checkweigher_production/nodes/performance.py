# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Performance test of the selected product, with its entries in the audit log."""

from collections.abc import Callable
from dataclasses import dataclass
import math

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import GRAMS, PerformanceState, PerformanceTest, Verdict
from checkweigher_production.audit_trail import AuditTrail, Author
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.performance import PerformanceTests, as_entry, from_entry
from checkweigher_production.recipes import Product

_HINT = 'make it: ./checkweigher performance, or the page'
_LEVELS = {
    PerformanceState.DUE: Level.WARN,
    PerformanceState.RUNNING: Level.WARN,
    PerformanceState.OVERDUE: Level.ERROR,
    PerformanceState.FAILED: Level.ERROR,
}


@dataclass(eq=False)
class LineTest:
    """Performance test of the selected product. All items are rejected during a test.

    `recipe` sets the reject node to reject all items, and `trail` writes the audit log. `publish`
    publishes the state, and `clock` returns the time of the system clock in ns.
    """

    recipe: LineRecipe
    trail: AuditTrail
    publish: Callable[[PerformanceTest], object]
    clock: Callable[[], int]

    def __post_init__(self) -> None:
        self._tests = PerformanceTests()
        self._reason = ''
        self._rejecting = False  # whether the reject node was set to reject all items

    def select(self, product: Product, batch: str) -> None:
        """Cancel a running test, and begin to observe the due times of a product and a batch."""
        if (entry := self.trail.last(changes.TEST, product.name)) is not None:
            self._tests.remember(product.name, from_entry(entry))
        self._tests.select(product.name, batch, product.test, self.clock())
        self.publish(self._tests.state)

    async def begin(self, by: Author) -> str:
        """Begin a test, and return an instruction for the person who makes it.

        Raises ValueError if `by` names no person, if the recipe requires no test, or if a test is
        running already. Raises `AuditError` if the audit log cannot be written, and `RefusedError`
        if the reject node does not confirm that it rejects all items.
        """
        who = by.who.strip()
        if not who:
            raise ValueError('the person who makes the performance test must be named')
        plan = self._tests.plan_to_begin()
        product = self._tests.state.product
        self.trail.note(changes.TEST_BEGUN, product, None, True, by._replace(who=who))
        await self.recipe.change(performance_test=True)
        self._rejecting, self._reason = True, by.why
        self._tests.begin(who, self.clock())
        self.publish(self._tests.state)
        return f'let the test product of {GRAMS * plan.mass:g} g pass {plan.passes} times'

    async def cancel(self, by: Author) -> str:
        """Cancel a running test, and return a message for the person.

        Raises `AuditError` if the audit log cannot be written. The test then continues.
        """
        if not self._tests.wanted:
            return 'no performance test was under way'
        self.trail.note(changes.TEST_BEGUN, self._tests.state.product, True, False, by)
        self._tests.cancel(self.clock())
        self.publish(self._tests.state)
        return 'the performance test was broken off'

    def take(self, verdict: Verdict) -> None:
        """Add a verdict as a pass of the test product if a test is running.

        If the pass completes the test, its result is written to the audit log.
        """
        before, plan = self._tests.state, self._tests.plan
        ended = self._tests.take(verdict, self.clock())
        if ended is not None and plan is not None:
            entry = as_entry(plan, ended, self._reason)
            author = Author(ended.who, self._reason)
            self.trail.saw(changes.TEST, before.product, None, entry, author)
        if self._tests.state is not before:
            self.publish(self._tests.state)

    async def advance(self) -> None:
        """Update the state, and set the reject node to accept items again after a test.

        Raises `RefusedError` if the reject node does not confirm that it accepts items again. The
        next call tries again.
        """
        if self._tests.advance(self.clock()):
            self.publish(self._tests.state)
        if self._rejecting and not self._tests.wanted:
            await self.recipe.change(performance_test=False)
            self._rejecting = False

    def finding(self) -> Finding:
        """Return the diagnostics finding "Performance test", with the state and the last errors."""
        state = self._tests.state
        well = {
            PerformanceState.NOT_ASKED: 'the recipe asks for none',
            PerformanceState.IN_TIME: 'in time',
        }
        text = state.text or f'{state.who} makes it: {len(state.errors)} of {state.passes}'
        level = _LEVELS.get(state.state)
        concern = Concern(level, f'{state.state.name}: {text}', _HINT) if level else None
        values: dict[str, float | str] = {
            'who': state.who,
            'passes': len(state.errors),
            'largest_error_g': GRAMS * max(map(abs, state.errors), default=math.nan),
        }
        return conclude('Performance test', well.get(state.state, ''), [concern], values)
