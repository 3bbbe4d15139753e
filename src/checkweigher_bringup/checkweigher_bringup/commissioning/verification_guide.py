# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verification procedure on a running line, step by step, with an operator."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
import math
from pathlib import Path
import queue
import threading
import time

from rclpy.exceptions import InvalidHandle
from rclpy.parameter_client import AsyncParameterClient
from rclpy.serialization import serialize_message
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.identity import Identity, NodeValues
from checkweigher_bringup.commissioning.lane_client import answer_of, call
from checkweigher_bringup.commissioning.sample_feed import SampleFeed
from checkweigher_bringup.commissioning.static_guide import read_at_rest
from checkweigher_bringup.commissioning.verification_bags import end_of_block
from checkweigher_bringup.commissioning.verification_operator import BrokenOffError, Operator
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.recorder import RecorderNode
from checkweigher_core.recording import Recording
from checkweigher_core.records import (
    GRAMS,
    NANOSECONDS,
    LoadCell,
    SampleBlock,
    StepState,
    Verdict,
    VerificationStep,
    ZeroChange,
)
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_core.ros.line_parameters import python_value
from checkweigher_core.ros.spinner import Spinner
from checkweigher_driver.calibration.static_calibration import CalibrationError, Steadiness
from checkweigher_recording.bags.writing import BagWriter
from checkweigher_validation.verification.evaluation import Result, outcome_of
from checkweigher_validation.verification.plan import MINUTE, Plan
from checkweigher_validation.verification.procedure import (
    Attempt,
    ItemPass,
    Procedure,
    item_pass,
    reading_between,
)
from checkweigher_validation.verification.steps import Step, StepKind, steps_of

# Maximum times in s to wait for an answer during the steps, and after the last step. The time
# during the steps is long, because zeroing needs an empty belt. The time after the last step is
# short, because the line may be about to end.
_ANSWER_PATIENCE, _LAST_PATIENCE = 20.0, 2.0
# Beginnings of the names of parameters that each ROS node has, and that do not affect the weighing.
_NOT_OURS = ('use_sim_time', 'qos_overrides', 'start_type_description_service')
_SILENCE = 10.0  # time in s without a product after which a message is shown to the operator
_POLL_PERIOD = 0.1  # s
_TRAIL = 0.5  # duration in s of the samples that are recorded after the last step


def procedure_on_line(
    spinner: Spinner, plan: Plan, text: str, identity: Identity, output: Path, operator: Operator
) -> None:
    """Guide an operator through the steps of a plan, and record the procedure into a bag.

    The parameters of the line are read before the first step and after the last step. If the
    operator cancels the procedure, the bag contains the steps so far. Raises `UserError` if the
    line is not running, or does not answer, and `OutputError` if the bag cannot be written.
    """
    node = VerificationNode()
    spinner.add(node)
    try:
        cell = node.feed.wait_for_load_cell()
        for _ in node.feed.blocks():
            if node.latest:
                break
        what = identity.at_begin(_parameters(node, _ANSWER_PATIENCE), 'on a running line')
        lane = node.get_namespace().strip('/')
        with (
            BagWriter(output, ports.RECORDED, lane, in_place=True) as bag,
            _writing(bag, node) as check_bag,
        ):
            node.tell(VerificationStep(node.latest, '', StepState.PLAN, text=text))
            node.tell(VerificationStep(node.latest, '', StepState.IDENTITY, text=what))
            with suppress(BrokenOffError):
                _Guide(node, plan, cell, operator, check_bag).run()
            # A line that is shutting down may not answer. The report then states that the
            # parameters were not read again.
            with suppress(UserError, InvalidHandle):
                if spinner.alive:
                    what = identity.at_end(_parameters(node, _LAST_PATIENCE))
                    node.tell(VerificationStep(node.latest, '', StepState.IDENTITY, text=what))
    finally:
        if spinner.alive:
            spinner.remove(node)


class VerificationNode(RecorderNode):
    """Node that records a lane, and that provides the samples and verdicts for the steps.

    Any thread may read the queue `verdicts`. `zeros` contains the changes of the zero that the node
    has received. `latest` is the end of the latest sample or the latest t3 of a verdict, whichever
    is later, in ns. `latest` is 0 until samples or a verdict have arrived.
    """

    def __init__(self) -> None:
        recorded = tuple(port for port in ports.RECORDED if port is not ports.VERIFICATION)
        super().__init__(recorded, None, ports.VERIFICATION.maker)
        self.feed = SampleFeed(self.resolve_topic_name(ports.LOAD_CELL_SAMPLES.name))
        self.verdicts: queue.Queue[Verdict] = queue.Queue()
        self.zeros: list[ZeroChange] = []
        self.latest = 0
        port = ports.VERIFICATION
        self._told = self.create_publisher(port.type, port.name, port.qos)
        self.subscribe(ports.LOAD_CELL_INFO, self.feed.put, qos=ports.LOAD_CELL_INFO.qos)
        self.subscribe(ports.LOAD_CELL_SAMPLES, self._on_samples)
        self.subscribe(ports.VERDICT, self._on_verdict)
        self.subscribe(ports.ZERO_SETTING, self.zeros.append)

    def tell(self, step: VerificationStep) -> None:
        """Publish a step and record it."""
        message = to_message(ports.VERIFICATION, step)
        self._told.publish(message)
        self.messages.put((ports.VERIFICATION, time.time_ns(), serialize_message(message)))

    def _on_samples(self, block: SampleBlock) -> None:
        if self.feed.load_cell is not None:
            self.latest = max(self.latest, end_of_block(block, self.feed.load_cell))
        self.feed.put(block)

    def _on_verdict(self, verdict: Verdict) -> None:
        # A verdict may arrive before the samples of its time. Increase `latest`, so that the next
        # step begins after this verdict.
        self.latest = max(self.latest, verdict.t3 or 0)
        self.verdicts.put(verdict)


@contextmanager
def _writing(bag: BagWriter, node: VerificationNode) -> Iterator[Callable[[], None]]:
    """Write the recorded messages to the bag, in another thread, until the context ends.

    Yields a function that raises `OutputError` if a message could not be written. When the context
    ends, waits until all messages are written. Raises `OutputError` if a message could not be
    written, unless the context has raised another exception.
    """
    ending = threading.Event()

    def write() -> None:
        while not (ending.is_set() and node.messages.empty()):
            node.write(bag)

    with ThreadPoolExecutor(1) as pool:
        written = pool.submit(write)

        def check() -> None:
            if written.done():
                written.result()

        try:
            yield check
        finally:
            ending.set()
    written.result()


class _Guide:
    def __init__(
        self,
        node: VerificationNode,
        plan: Plan,
        load_cell: LoadCell,
        operator: Operator,
        check_bag: Callable[[], None],
    ) -> None:
        self._node = node
        self._plan = plan
        self._cell = load_cell
        self._operator = operator
        self._check_bag = check_bag
        self._steadiness = Steadiness(plan.rest.duration_s, plan.rest.tolerance)
        self._attempts: list[Attempt] = []
        self._last: Result | None = None  # result of the last attempt, unless it was skipped
        self._warm: int | None = None  # start of the warm-up in ns

    def run(self) -> None:
        """Guide the operator through all steps, and wait for the samples after the last step.

        The wait ends when `_TRAIL` s of samples have arrived, or after `4 * _TRAIL` s.

        Raises `BrokenOffError` if the operator cancels the procedure. Raises `OutputError` after a
        step if the bag could not be written, because further steps would be in vain.
        """
        steps = steps_of(self._plan)
        self._operator.begin(steps)
        for number, step in enumerate(steps):
            asks = not self._leaves_belt_empty(step)
            while not self._make(number, step, asks=asks):
                self._check_bag()
                asks = True
            self._check_bag()
        end = self._node.latest + round(_TRAIL * NANOSECONDS)
        patience = time.monotonic() + 4 * _TRAIL
        while self._node.latest < end and time.monotonic() < patience:
            time.sleep(_POLL_PERIOD)

    def _leaves_belt_empty(self, step: Step) -> bool:
        """Return whether a step is a further reading after a reading of the empty belt that passed.

        The operator has nothing to do for such a step, so it begins without a question.
        """
        last = self._last
        return (
            step.kind is StepKind.ZERO
            and last is not None
            and last.attempt.step.kind in (StepKind.ZEROING, StepKind.ZERO)
            and last.passed
        )

    def _make(self, number: int, step: Step, *, asks: bool) -> bool:
        """Guide the operator through a step, and return whether it was completed or skipped.

        If `asks` is false, the step begins at once, otherwise when the operator has followed its
        instruction. If False is returned, the step must be repeated, because it could not be
        measured, or because it failed and the operator decided to repeat it.
        """
        self._wait_for_warm_up(step)
        node = self._node
        if not asks:
            self._operator.start(number)
        elif reason := self._operator.asked(number, step):
            now = node.latest
            node.tell(VerificationStep(now, step.name, StepState.SKIPPED, None, reason))
            self._attempts.append(Attempt(step, now, now, skipped=reason))
            self._last = None
            return True
        begin = node.latest
        if step.minutes is not None and self._warm is None:
            self._warm = begin
        node.tell(VerificationStep(begin, step.name, StepState.BEGUN, begin))
        try:
            attempt = self._read(step) if step.at_rest else self._count(step, begin)
        except (CalibrationError, UserError) as error:  # the step has no result and is repeated
            self._operator.tell(f'{step.name}: {error}')
            return False
        node.tell(VerificationStep(attempt.end, step.name, StepState.DONE, attempt.begin))
        self._attempts.append(attempt)
        zeros = tuple(node.zeros)
        procedure = Procedure(self._plan, '', {}, self._cell, tuple(self._attempts), zeros, '')
        self._last = found = outcome_of(procedure).results[-1]
        return self._operator.goes_on(number, _line(found), passed=found.passed)

    def _wait_for_warm_up(self, step: Step) -> None:
        if step.minutes is None or self._warm is None:
            return
        due = self._warm + round(step.minutes * MINUTE * NANOSECONDS)
        while (left := due - self._node.latest) > 0:
            self._operator.show(f'{step.name}: begins in {left / NANOSECONDS:.0f} s')
            time.sleep(_POLL_PERIOD)

    def _read(self, step: Step) -> Attempt:
        feed = self._node.feed
        if step.kind == StepKind.ZEROING:
            self._operator.show('the zero is being set')
            answer = call(self._node, Trigger, ports.ZERO, _ANSWER_PATIENCE)
            self._operator.tell(f'zero: {answer.message}')
        read_at_rest(feed, self._cell, self._steadiness, self._operator.show)
        end = end_of_block(feed.taken[-1], self._cell)
        begin = end - round(self._steadiness.duration * NANOSECONDS)
        # Use the same blocks as the report, so that the operator sees the same mass.
        samples = Recording(self._cell, feed.taken, ())
        return Attempt(step, begin, end, reading=reading_between(samples, begin, end))

    def _count(self, step: Step, begin: int) -> Attempt:
        """Wait for the weighed passes of a step, and return all passes of the step.

        The step began at the time `begin` in ns, so earlier items are ignored. The returned passes
        include those that were not weighed. Raises `BrokenOffError` if the operator cancels the
        procedure.
        """
        assert step.load is not None
        items: list[ItemPass] = []
        latest = time.monotonic()
        while (count := _count_weighed(step, items)) < step.count:
            self._operator.show(f'{count} of {step.count} passes')
            try:
                verdict = self._node.verdicts.get(timeout=_POLL_PERIOD)
            except queue.Empty:
                if time.monotonic() - latest > _SILENCE:
                    latest = time.monotonic()
                    self._operator.tell(f'no product within {_SILENCE:.0f} s')
                continue
            latest = time.monotonic()
            # The planned speed is used, because a verdict has no belt speed. The report uses the
            # speed of the estimate.
            item = item_pass(verdict, step.speed or math.nan)
            if item.stamp < begin:
                continue
            items.append(item)
            found = f'{GRAMS * item.mass:.3f} g, {GRAMS * (item.mass - step.load.mass):+.3f} g'
            found = found if item.weighed else f'no mass, {", ".join(item.reasons)}'
            self._operator.tell(f'{_count_weighed(step, items)} of {step.count} passes: {found}')
        return Attempt(step, begin, items[-1].stamp, tuple(items))


def _count_weighed(step: Step, items: list[ItemPass]) -> int:
    """Return the number of items that count as passes of a step.

    An item counts as a pass if it was weighed. In a step outside the range of the dynamic setting,
    all items count, because each of them must get the decision FAULT.
    """
    return sum(item.weighed or step.kind == StepKind.OUTSIDE for item in items)


def _line(result: Result) -> str:
    parts = ['passed' if result.passed else 'FAILED']
    if (reading := result.attempt.reading) is None:
        parts.append(f'n {result.count}, faults {result.faults}')
    else:
        parts.append(f'reading {GRAMS * reading.mass:+.4f} g')
    for name, value, limit in (
        ('error', result.error, result.max_error),
        ('std. dev.', result.std_dev, result.max_std_dev),
    ):
        if math.isfinite(value) and math.isfinite(limit):
            parts.append(f'{name} {GRAMS * value:+.4f} g of {GRAMS * limit:.4f} g')
    return ', '.join([*parts, *result.failures])


def _parameters(node: VerificationNode, patience: float) -> NodeValues:
    """Return the parameters of the nodes of the line, by node and name.

    Waits for each answer for at most `patience` s. A node that is not a stage is left out if it is
    not discovered within 1 s. Raises `UserError` if a stage of the line does not run, or if a
    discovered node does not answer.
    """
    found: NodeValues = {}
    for name in ports.NODES:
        client = AsyncParameterClient(node, name)
        if not client.wait_for_services(patience if name in ports.STAGES else 1.0):
            if name in ports.STAGES:
                raise UserError(f'{name}: does not answer; is the line running?')
            continue
        listed = answer_of(client.list_parameters(), name, patience).result.names
        names = sorted(each for each in listed if not each.startswith(_NOT_OURS))
        values = answer_of(client.get_parameters(names), name, patience).values
        found[name] = dict(zip(names, map(python_value, values), strict=True))
    return found
