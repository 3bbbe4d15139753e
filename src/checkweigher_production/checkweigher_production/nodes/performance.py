# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The performance test of the product on the line: its times, its passes, its entries."""

from collections.abc import Callable
from datetime import UTC, datetime
import math

from checkweigher_core import changes
from checkweigher_core.health.findings import Concern, Finding, Level, conclude
from checkweigher_core.records import GRAMS, PerformanceState, PerformanceTest, Verdict
from checkweigher_production.audit_trail import AuditTrail
from checkweigher_production.authors import Author
from checkweigher_production.nodes.line_recipe import LineRecipe
from checkweigher_production.performance import (
    PerformanceTests,
    as_entry,
    from_entry,
)
from checkweigher_production.recipes import Product

_HINT = 'make it: ./checkweigher performance, or the page'
_LEVELS = {
    PerformanceState.DUE: Level.WARN,
    PerformanceState.RUNNING: Level.WARN,
    PerformanceState.OVERDUE: Level.ERROR,
    PerformanceState.FAILED: Level.ERROR,
}


class LineTest:
    """The performance test, with what it needs of the line.

    `publish` takes each new state, `clock` returns ns of the system clock. The line rejects all
    items while a test goes on, which `recipe` has the reject node know.
    """

    def __init__(
        self, recipe: LineRecipe, trail: AuditTrail,
        publish: Callable[[PerformanceTest], object], clock: Callable[[], int],
    ) -> None:  # fmt: skip
        self._recipe = recipe
        self._trail = trail
        self._publish = publish
        self._clock = clock
        self._tests = PerformanceTests(datetime.now(UTC).astimezone().tzinfo or UTC)
        self._reason = ''
        self._rejecting = False  # whether the reject node knows that a test goes on

    def select(self, product: Product, batch: str) -> None:
        """Take the product and the batch on the line, whose parameters are set."""
        if (entry := self._trail.last(changes.TEST, product.name)) is not None:
            self._tests.remember(product.name, from_entry(entry))
        self._tests.select(product.name, batch, product.test, self._clock())
        self._publish(self._tests.state)

    async def begin(self, who: str, reason: str) -> str:
        """Begin a test; return what to do. ValueError or RefusedError says why it is not begun."""
        who = who.strip()
        if not who:
            raise ValueError('who makes the performance test has to be named')
        plan = self._tests.plan_to_begin()
        product = self._tests.state.product
        self._trail.note(changes.TEST_BEGUN, product, None, True, Author(who, reason))
        await self._recipe.change(performance_test=True)
        self._rejecting, self._reason = True, reason
        self._tests.begin(who, self._clock())
        self._publish(self._tests.state)
        return f'let the test product of {GRAMS * plan.mass:g} g pass {plan.passes} times'

    async def cancel(self, who: str, reason: str) -> str:
        """Break off the test that is under way; return what has become of it."""
        if not self._tests.wanted:
            return 'no performance test was under way'
        state = self._tests.state
        self._trail.note(changes.TEST_BEGUN, state.product, True, False, Author(who, reason))
        self._tests.cancel(self._clock())
        self._publish(self._tests.state)
        return 'the performance test was broken off'

    def take(self, verdict: Verdict) -> None:
        """Take a verdict, which may be a pass of the test."""
        passes = len(self._tests.state.errors)
        ended = self._tests.take(verdict, self._clock())
        plan = self._tests.plan
        if ended is not None and plan is not None:
            entry = as_entry(plan, ended, self._reason)
            product = self._tests.state.product
            author = Author(ended.who, self._reason)
            self._trail.saw(changes.TEST, product, None, entry, author)
        if ended is not None or len(self._tests.state.errors) != passes:
            self._publish(self._tests.state)

    async def look(self) -> None:
        """See what time has brought, and have the reject node accept again after a test."""
        if self._tests.advance(self._clock()):
            self._publish(self._tests.state)
        if self._rejecting and not self._tests.wanted:
            await self._recipe.change(performance_test=False)
            self._rejecting = False

    def finding(self) -> Finding:
        """Return the aspect Performance test of the diagnostics."""
        state = self._tests.state
        well = {
            PerformanceState.NOT_ASKED: 'the recipe asks for none',
            PerformanceState.IN_TIME: 'in time',
        }
        found = []
        if level := _LEVELS.get(state.state):
            text = state.text or f'{state.who} makes it: {len(state.errors)} of {state.passes}'
            found.append(Concern(level, f'{state.state.name}: {text}', _HINT))
        values: dict[str, float | str] = {'who': state.who, 'passes': len(state.errors)}
        worst = max((abs(each) for each in state.errors), default=math.nan)
        values['largest_error_g'] = GRAMS * worst
        return conclude('Performance test', well.get(state.state, ''), found, values)
