# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration, training and verification at the terminal by the actions of a line.

The nodes of the line do the work and write the results to their own files, as they do if a user
starts the work on the page.
"""

from collections.abc import Sequence
from contextlib import suppress
import math
from pathlib import Path

from checkweigher_msgs.action import ReadLoad, RecordPasses, RunVerification, TunePasses
from checkweigher_msgs.srv import AnswerVerification, FinishCalibration
from rclpy.node import Node
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.dynamic_guide import belt_speed, other_speed
from checkweigher_bringup.commissioning.lane_client import call, perform, technician
from checkweigher_bringup.commissioning.terminal import StepsAtTerminal, ask, show, tell
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.training import read_passes
from checkweigher_core.records import GRAMS, StepAnswer
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_record
from checkweigher_dsp.segmentation.parameters import SegmenterParameters

_FIT_PATIENCE = 20.0  # maximum time in s to wait until a calibration is written


def calibrate_line(
    namespace: str, masses: Sequence[float], mass_uncertainty: float, max_residual: float
) -> None:
    """Guide the technician through a calibration, and let the driver write its calibration file.

    The driver applies the new calibration without a restart. `masses` contains the known masses in
    kg in the order of their use. If `masses` is empty, only the zero is read. `mass_uncertainty` is
    the standard uncertainty of each mass, and `max_residual` the largest allowed residual, or 0
    without a limit, both in kg.

    Raises `UserError` if the driver does not offer the calibration or refuses it, or if the
    standard input ends. Nothing is then written.
    """
    with technician(namespace) as node:
        # Discard the readings of an unfinished calibration, which would otherwise become a part of
        # the new calibration.
        call(node, Trigger, ports.CANCEL_CALIBRATION)
        try:
            for mass in [0.0, *masses, 0.0] if masses else [0.0]:
                _read(node, mass, mass_uncertainty if mass else 0.0)
            name, limit = ports.FINISH_CALIBRATION, max_residual
            done = call(node, FinishCalibration, name, _FIT_PATIENCE, max_residual=limit)
        except BaseException:
            with suppress(UserError):  # the line may have ended
                call(node, Trigger, ports.CANCEL_CALIBRATION)
            raise
    for mass, residual in zip(done.masses, done.residuals, strict=True):
        print(f'{GRAMS * mass:g} g: residual {GRAMS * residual:+.4f} g')
    print(f'{done.message}; the line uses it now')


def _read(node: Node, mass: float, mass_uncertainty: float) -> None:
    ask(f'Put {GRAMS * mass:g} g on the belt' if mass else 'Empty the belt')
    goal = {'mass': mass, 'mass_uncertainty': mass_uncertainty}
    read = perform(node, ReadLoad, ports.READ_LOAD, _show_load, **goal)
    tell(f'{GRAMS * mass:g} g: {read.message}')


def _show_load(feedback: ReadLoad.Feedback) -> None:
    show(
        f'{feedback.duration:4.1f} of {feedback.wanted:g} s: {GRAMS * feedback.load:10.3f} g as '
        f'calibrated now, drift {GRAMS * feedback.drift:+.3f} g'
    )


def train_line(namespace: str, mass: float, passes: int, speeds: Sequence[float]) -> None:
    """Let the line record passes at each speed, train, and accept the result if the user confirms.

    `mass` is the mass in kg of each product, `passes` the number of passes at each speed, and
    `speeds` contains the belt speeds in m/min.

    Raises `UserError` if the line does not offer the dynamic setting or refuses it, or if the
    standard input ends.
    """
    with technician(namespace) as node:
        for speed in speeds:
            while not _is_recorded(node, mass, passes, speed):
                pass
        tell(perform(node, TunePasses, ports.TUNE_PASSES, _Training().follow).message)
        print(call(node, Trigger, ports.SHOW_TUNED).message)
        later = f'the service {ports.ACCEPT_TUNED} accepts them later'
        taken = ask('Type yes to accept these parameters', f'the parameters were accepted; {later}')
        if taken.lower() not in ('y', 'yes'):
            print(f'not accepted; {later}')
            return
        print(call(node, Trigger, ports.ACCEPT_TUNED).message)


def _is_recorded(node: Node, mass: float, passes: int, speed: float) -> bool:
    """Record passes, and return whether their belt speed is `speed` in m/min.

    A relative difference of up to 5 % is allowed, as in `other_speed`. If the bag of the passes is
    on another computer, the speed is not checked, and True is returned.
    """
    ask(f'Set the belt to {speed:g} m/min and run the line', 'all passes were recorded')
    goal = {'mass': mass, 'passes': passes}
    made = perform(node, RecordPasses, ports.RECORD_PASSES, lambda each: tell(each.text), **goal)
    print(f'{made.bag}: {made.message}' if made.bag else made.message)
    if not made.bag:  # the recording was ended before the first pass
        return False
    bag = Path(made.bag)
    if not bag.exists():
        print(f'{bag}: is on another computer, so the speed of its passes is not checked')
        return True
    known = read_passes([bag], None, SegmenterParameters()).passes
    if other := other_speed(belt_speed(known), speed):
        print(f'{other}; the training uses these passes, too, unless you remove {bag}')
    return not other


class _Training:
    """Terminal that shows the progress of a training, with a line for each phase."""

    def __init__(self) -> None:
        self._phase = ''

    def follow(self, feedback: TunePasses.Feedback) -> None:
        if feedback.text != self._phase:
            self._phase = feedback.text
            tell(self._phase)
        left = f', {feedback.remaining:.0f} s left' if math.isfinite(feedback.remaining) else ''
        show(f'{feedback.progress:.0%}{left}')


def verify_line(namespace: str, plan: str) -> tuple[str, str]:
    """Guide the operator through a verification, and return its verdict and the report's folder.

    `plan` is the text of the plan. If the user interrupts the command, the line writes a report of
    the steps so far.

    Raises `UserError` if the line does not offer the verification or refuses it, if it fails, or if
    the standard input ends.
    """
    with technician(namespace) as node:

        def send(question: int, answer: StepAnswer, reason: str) -> None:
            name, number = ports.ANSWER_VERIFICATION, int(answer)
            call(node, AnswerVerification, name, question=question, answer=number, reason=reason)

        steps = StepsAtTerminal(send)

        def follow(feedback: RunVerification.Feedback) -> None:
            steps.follow(to_record(ports.VERIFICATION_PROGRESS, feedback.progress))

        made = perform(node, RunVerification, ports.RUN_VERIFICATION, follow, plan=plan)
    return made.message, made.folder
