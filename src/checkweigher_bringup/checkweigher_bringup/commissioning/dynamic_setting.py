# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node that performs a dynamic setting: it records passes of known mass, and trains on them.

Training writes a new file beside the parameter file of the line. The service `accept_tuned`
replaces the parameter file by the new file. The commands `record` and `tune` run in their own
processes, because training takes minutes on all cores, and the line must not wait for the training.
"""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
import hashlib
import math
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
from typing import Any, ClassVar

from checkweigher_msgs.action import RecordPasses, TunePasses
from checkweigher_msgs.msg import DynamicSetting
from checkweigher_msgs.srv import RecordPasses as RecordPassesService
from rclpy.task import Future
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.machine_folder import own_folder
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import memory_file
from checkweigher_core.changes import TUNED
from checkweigher_core.parameters import Parameters, parameter
from checkweigher_core.parent_process import child_environment
from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_core.whole_file import OutputError
from checkweigher_driver.calibration.file import replace_version
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_recording.progress import PROGRESS, read_progress
from checkweigher_validation.tuning.parameter_file import accuracy_lines

_POLL_PERIOD = 0.1  # s
_END_PATIENCE = 20.0  # maximum time in s for a child process to complete its bag
_NICENESS = 10  # niceness of the training, which gives the line priority
_NOTHING_WAITS = f'there are no learned parameters to accept; train by {ports.TUNE_PASSES} first'
_Tell = Callable[..., None]  # function that publishes the feedback of an action


@dataclass(frozen=True)
class DynamicSettingParameters(Parameters):
    """Parameters of the node that records passes and trains the estimators."""

    node: ClassVar[str] = 'dynamic_setting'

    folder: str = parameter('', 'folder for the bags passes_N and for machine.yaml; must be given')
    estimator: str = parameter(
        'best',
        'estimator that is trained, and that is selected in machine.yaml; best: train several, and '
        'select the most accurate one on held-out passes',
        choices=('best', *ESTIMATORS),
    )
    budget: int = parameter(
        240,
        'largest number of evaluations of each estimator at each speed',
        minimum=1,
        maximum=1_000_000,
    )
    parameters: str = parameter(
        '', 'file of the parameters that are not trained; empty for the defaults'
    )
    restart_file: str = parameter(
        '', 'file that the node creates to request a restart of the line; empty: no restart by it'
    )


class DynamicSettingNode(StageNode[DynamicSettingParameters]):
    """Node that records passes and trains estimators in child processes."""

    _child: subprocess.Popen[bytes] | None = None
    _ended: Future  # result of the child process: whether it has succeeded, and a text

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        self._scratch = ExitStack()
        super().__init__(DynamicSettingParameters, read_only=True, overrides=overrides)
        self._folder = own_folder(self, self.parameters.folder)
        self._file = self._folder / 'machine.yaml'
        self._learned = self._folder / 'machine.new.yaml'  # trained parameters, not accepted yet
        self._recording: Path | None = None
        self._cancelled = False
        self._output, self._errors = (self._scratch.enter_context(memory_file()) for _ in range(2))
        port = ports.DYNAMIC_SETTING
        self._publisher = self.create_publisher(port.type, port.name, port.qos)
        self.create_action(RecordPasses, ports.RECORD_PASSES, self._record, self._end)
        self.create_action(TunePasses, ports.TUNE_PASSES, self._tune, self._end)
        begin = self._begin_recording_by_service
        self.create_service(RecordPassesService, ports.RECORD_PASSES, begin)
        for name, callback in (
            (ports.TUNE_PASSES, self._begin_training_by_service),
            (ports.CANCEL_PASSES, self._cancel),
            (ports.SHOW_TUNED, self._show),
            (ports.RESTART_LINE, self._restart),
            (ports.ACCEPT_TUNED, self._accept),
        ):
            self.create_service(Trigger, name, callback)
        self._timer = self.create_timer(_POLL_PERIOD, self._poll, autostart=False)
        self._publish_state(DynamicSetting.IDLE, self._waiting() if self._learned.exists() else '')

    def _bags(self) -> dict[int, Path]:
        """Return the bags of passes by number, in ascending order."""
        found = {
            int(number.group(1)): path
            for path in self._folder.glob('passes_*')
            if (number := re.fullmatch(r'passes_(\d+)', path.name))
        }
        return dict(sorted(found.items()))

    def _recorded(self) -> list[Path]:
        """Return the bags of passes in the order of recording.

        The bag of a current recording is left out.
        """
        return [path for path in self._bags().values() if path != self._recording]

    def _publish_state(self, state: int, text: str, **values: Any) -> None:
        self._said = DynamicSetting(
            state=state,
            text=text,
            bags=[str(bag) for bag in self._recorded()],
            file=str(self._file) if self._file.exists() else '',
            **{'mass': math.nan, **values},
        )
        self._publish()

    def _publish(self) -> None:
        self._said.header.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(self._said)

    def _waiting(self) -> str:
        """Return a text with the services that show, accept or discard the learned parameters."""
        return (
            f'tuned: {self._learned} is ready; {ports.SHOW_TUNED} shows its accuracy, '
            f'{ports.ACCEPT_TUNED} accepts it, {ports.CANCEL_PASSES} discards it'
        )

    # Actions and services

    def _check_idle(self) -> None:
        if self._child is not None:
            raise UserError(f'busy: {self._said.text}; wait, or cancel it')

    async def _record(self, goal: Any, result: Any, tell: _Tell) -> None:
        bag = self._begin_recording(goal, tell)
        result.message = await _success(self._ended)
        result.bag = str(bag) if bag.exists() else ''

    async def _tune(self, goal: Any, result: Any, tell: _Tell) -> None:
        self._begin_training(tell)
        result.message = await _success(self._ended)

    def _begin_recording(self, known: Any, tell: _Tell) -> Path:
        """Begin to record passes, and return the path of their bag.

        Raises `UserError` if a recording or training is in progress, or if the mass or the number
        of passes is not above 0.
        """
        self._check_idle()
        mass, passes = known.mass, known.passes
        if not (math.isfinite(mass) and mass > 0 and passes > 0):
            raise UserError(f'mass {mass:g} kg, passes {passes}: both must be above 0')
        bag = self._folder / f'passes_{max(self._bags(), default=0) + 1}'
        self._recording = bag
        options = ('--reference', f'{GRAMS * mass:.6f}', '--passes', passes)
        lane = self.get_namespace().strip('/')
        command = ('record', '--output', bag, '--inputs-only', *options, '--namespace', lane)
        self._begin(tell, *command)
        values = {'mass': float(mass), 'wanted': int(passes)}
        self._publish_state(DynamicSetting.RECORDING, 'waiting for the first pass', **values)
        return bag

    def _begin_training(self, tell: _Tell) -> None:
        self._check_idle()
        bags, known = self._recorded(), self.parameters
        if not bags:
            raise UserError(f'{self._folder}: no passes; record some by {ports.RECORD_PASSES}')
        options = ['--params', known.parameters] if known.parameters else []
        options += ['--estimator', known.estimator] if known.estimator != 'best' else []
        self._learned.unlink(missing_ok=True)
        output = ('--output', self._learned, '--overwrite', '--budget', known.budget)
        self._begin(tell, 'tune', *bags, *output, *options)
        self._publish_state(DynamicSetting.TUNING, f'{known.estimator} on {len(bags)} bags')

    def _begin_recording_by_service(self, request: Any, response: Any) -> str:
        self.warn_of(ports.RECORD_PASSES, ports.RECORD_PASSES)
        response.bag = str(self._begin_recording(request, _tell_nobody))
        return ''

    def _begin_training_by_service(self, request: Any, response: Any) -> str:
        self.warn_of(ports.TUNE_PASSES, ports.TUNE_PASSES)
        self._begin_training(_tell_nobody)
        return f'training has begun; {ports.DYNAMIC_SETTING.name} reports its end'

    def _end(self) -> None:
        """Send SIGTERM to the child process, if there is one. Recorded passes are kept.

        The method does not wait for the end of the process, which `_poll` detects.
        """
        if self._child is not None:
            self._cancelled = True
            self._interrupt(self._child)

    def _cancel(self, request: Any, response: Any) -> str:
        """End a recording or training in progress or, if there is none, discard learned parameters.

        Returns a message for the user, also if there is nothing to cancel.
        """
        if self._child is not None:
            self._end()
            return 'recording or training ends; passes that were weighed are kept'
        if not self._learned.exists():
            return 'nothing to cancel'
        self._learned.unlink()
        text = f'the learned parameters were discarded; {self._file} is unchanged'
        self._publish_state(DynamicSetting.IDLE, text)
        return text

    def _candidate(self) -> bytes:
        """Return the content of the new parameter file, or raise `UserError` if there is none."""
        try:
            return self._learned.read_bytes()
        except FileNotFoundError:
            raise UserError(_NOTHING_WAITS) from None

    def _show(self, request: Any, response: Any) -> str:
        return '\n'.join(accuracy_lines(self._candidate().decode('utf-8', errors='replace')))

    async def _accept(self, request: Any, response: Any) -> str:
        """Write an entry to the audit log, and then replace the parameter file by the new file.

        If the file cannot be replaced, a second entry states this.

        Raises `UserError` if there is no new parameter file, a child process runs, the first entry
        cannot be written, the new file has changed while the entry was written, or the parameter
        file cannot be replaced.
        """
        self._check_idle()
        learned = self._candidate()
        name = self.get_fully_qualified_name()
        value = {'file': str(self._file), 'sha256': hashlib.sha256(learned).hexdigest()}
        if reason := await self.change_record.write(TUNED, name, value):
            raise UserError(f'{reason}: not accepted')
        try:
            self._check_idle()
            if self._candidate() != learned:
                raise UserError('the learned parameters have changed in the meantime')
            version = replace_version(self._file, self._learned)
        except (UserError, OutputError, OSError) as error:
            text = f'not accepted: {error}'
            await self.change_record.write(TUNED, name, text)
            raise UserError(text) from None
        text = f'{self._file}, version {version}; the line uses it from its next start'
        self._publish_state(DynamicSetting.IDLE, text)
        self.get_logger().info(text)
        return text

    def _restart(self, request: Any, response: Any) -> str:
        """Request a restart of the line, which then reads the parameter file again.

        Raises `UserError` if the line was not started by `run --folder`, so that the parameter
        `restart_file` is empty, or if the file of the request cannot be written.
        """
        file = self.parameters.restart_file
        if not file:
            raise UserError('only a line of `run --folder` can be restarted by this service')
        try:
            Path(file).touch()
        except OSError as error:
            raise UserError(f'{file}: {error.strerror}') from None
        return 'the line restarts'

    # The child process

    def _interrupt(self, child: subprocess.Popen[bytes]) -> None:
        """Send SIGTERM to a child process and its worker processes, unless the child has ended.

        SIGINT is not used, because a child process that is starting may still ignore SIGINT. A
        shell starts background commands with SIGINT ignored, and child processes inherit this
        setting.
        """
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGTERM)

    def _begin(self, tell: _Tell, *words: object) -> None:
        """Start a command in a child process, and watch it by `_poll`.

        `words` contains the name and the arguments of the command. The function `tell` publishes
        the progress of the command as feedback of an action. `_ended` is set when the command has
        ended.
        """
        self._cancelled, self._line = False, ''
        self._tell, self._ended = tell, Future()
        with self._output.open('w') as output, self._errors.open('w') as errors:
            self._child = subprocess.Popen(
                [sys.executable, '-m', 'checkweigher_bringup.cli', *map(str, words)],
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=errors,
                env={**child_environment(), 'PYTHONUNBUFFERED': '1', PROGRESS: 'lines'},
                process_group=0,  # Ctrl-C reaches only this process, which then ends the child
            )
        self._timer.reset()
        if words[0] == 'tune':
            os.setpriority(os.PRIO_PROCESS, self._child.pid, _NICENESS)

    def _poll(self) -> None:
        """Publish the progress of the child process and its end."""
        if self._child is None:
            return
        status = self._child.poll()
        lines = _lines(self._output)
        if lines and lines[-1] != self._line:
            self._line = lines[-1]
            self._publish_progress(lines)
        if status is not None:
            self._child = None
            self._timer.cancel()
            self._finish(status)

    def _publish_progress(self, lines: list[str]) -> None:
        """Publish the progress that the child process has printed.

        `lines` contains all lines of the output so far. During a training, the last line is ignored
        if it contains no progress.
        """
        if self._said.state == DynamicSetting.RECORDING:
            self._said.text = lines[-1]
            self._said.passes = sum(line.startswith('pass ') for line in lines)
            self._publish()
            self._tell(passes=self._said.passes, text=self._said.text)
        elif (found := read_progress(lines[-1])) is not None:
            self._tell(text=found.doing, progress=found.share, remaining=found.remaining)

    def _finish(self, status: int) -> None:
        """Publish the result of the child process, and remove useless files.

        A bag without passes, and the parameters of a failed or cancelled training, are removed.
        """
        said, values = self._said, dict[str, Any]()
        if self._recording is not None:
            text = f'{said.passes} of {said.wanted} passes of {GRAMS * said.mass:g} g recorded'
            values = {'passes': said.passes, 'wanted': said.wanted, 'mass': said.mass}
            if not said.passes:
                shutil.rmtree(self._recording, ignore_errors=True)
            self._recording = None
        else:
            text = 'training cancelled' if self._cancelled else self._waiting()
            if status or self._cancelled:
                self._learned.unlink(missing_ok=True)
        if status and not self._cancelled:
            errors = _lines(self._errors) or [f'exit status {status}']
            text = errors[-1]
            self._publish_state(DynamicSetting.FAILED, text)
            self.warn(text)
        else:
            self._publish_state(DynamicSetting.IDLE, text, **values)
            self.get_logger().info(text)
        self._ended.set_result((not status or self._cancelled, text))

    def destroy_node(self) -> None:
        """End the child process, and destroy the node.

        A child process that does not end within `_END_PATIENCE` s is killed.
        """
        if self._child is not None:
            self._interrupt(self._child)
            try:
                self._child.wait(_END_PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(self._child.pid, signal.SIGKILL)
                self._child.wait()
        self._scratch.close()
        super().destroy_node()


def _tell_nobody(**_: object) -> None:
    """Ignore the feedback, because a service cannot publish feedback."""


async def _success(ended: Future) -> str:
    """Wait for the result of a child process, and return its text.

    If the process has failed, `UserError` is raised with this text.
    """
    succeeded, text = await ended
    if not succeeded:
        raise UserError(text)
    return str(text)


def _lines(file: Path) -> list[str]:
    text = file.read_text(encoding='utf-8', errors='replace')
    return [line.strip() for line in text.splitlines() if line.strip()]


main = partial(run, DynamicSettingNode)

if __name__ == '__main__':
    main()
