# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The dynamic setting by services: passes of known mass at each belt speed, then training.

The file that training writes waits beside the parameters of the line until `accept_tuned`.
The commands `record` and `tune` run in processes of their own: training takes minutes of all
cores, and the line must not wait for it.
"""

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

from checkweigher_msgs.msg import DynamicSetting
from checkweigher_msgs.srv import RecordPasses
from std_srvs.srv import Trigger

from checkweigher_bringup.commissioning.machine_folder import own_folder
from checkweigher_bringup.spinning import memory_file
from checkweigher_core.changes import TUNED
from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.parent_process import child_environment
from checkweigher_core.records import GRAMS
from checkweigher_core.ros import ports
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_core.whole_file import OutputError
from checkweigher_driver.calibration.file import replace_version
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_validation.tuning.parameter_file import accuracy_lines

_POLL_PERIOD = 0.1  # s
_END_PATIENCE = 20.0  # s, for a child to complete its bag
_LESS_URGENT = 10  # than the line; nice
_NOTHING_WAITS = f'nothing that was learned waits; call {ports.TUNE_PASSES} first'


@dataclass(frozen=True)
class DynamicSettingParameters(Parameters):
    """Where what is recorded and learned goes, and what is trained."""

    node: ClassVar[str] = 'dynamic_setting'

    folder: str = parameter('', 'folder for the bags passes_N and for machine.yaml, must be given')
    estimator: str = parameter(
        'best', 'estimator to train and to select in machine.yaml; best: the best of all on passes '
        'that were held out',
        choices=('best', *ESTIMATORS),
    )  # fmt: skip
    budget: int = parameter(240, 'evaluations at each speed', minimum=1, maximum=1_000_000)
    parameters: str = parameter(
        '', 'parameter file of everything that is not trained; empty for the defaults'
    )
    restart_file: str = parameter(
        '', 'file by which the line is asked to start again; empty without `run --folder`'
    )


class DynamicSettingNode(StageNode[DynamicSettingParameters]):
    """Record passes and train on them, one after the other, each in a process of its own."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(DynamicSettingParameters, read_only=True, overrides=overrides)
        try:
            self._folder = own_folder('dynamic_setting', self.parameters.folder)
        except ParameterError:
            self.destroy_node()
            raise
        self._file = self._folder / 'machine.yaml'
        self._learned = self._folder / 'machine.new.yaml'  # until it is taken over
        self._child: subprocess.Popen[bytes] | None = None
        self._recording: Path | None = None
        self._cancelled = False
        self._scratch = ExitStack()
        self._output, self._errors = (self._scratch.enter_context(memory_file()) for _ in range(2))
        port = ports.DYNAMIC_SETTING
        self._publisher = self.create_publisher(port.type, port.name, port.qos)
        self.create_service(RecordPasses, ports.RECORD_PASSES, self._on_record)
        self.create_service(Trigger, ports.TUNE_PASSES, self._on_tune)
        self.create_service(Trigger, ports.CANCEL_PASSES, self._on_cancel)
        self.create_service(Trigger, ports.SHOW_TUNED, self._on_show)
        self.create_service(Trigger, ports.ACCEPT_TUNED, self._on_accept)
        self.create_service(Trigger, ports.RESTART_LINE, self._on_restart)
        self._timer = self.create_timer(_POLL_PERIOD, self._poll, autostart=False)
        self._tell(DynamicSetting.IDLE, self._waiting() if self._learned.exists() else '')

    def _bags(self) -> list[Path]:
        """Return the bags in the order of recording, without the one that is being recorded."""
        found = ((_number(path), path) for path in self._folder.glob('passes_*'))
        return [path for number, path in sorted(found) if number and path != self._recording]

    def _tell(self, state: int, text: str, **values: Any) -> None:
        """Publish a new state."""
        self._said = DynamicSetting(
            state=state,
            text=text,
            bags=[str(bag) for bag in self._bags()],
            file=str(self._file) if self._file.exists() else '',
            **{'mass': math.nan, **values},
        )
        self._publish()

    def _publish(self) -> None:
        self._said.header.stamp = self.get_clock().now().to_msg()
        self._publisher.publish(self._said)

    def _waiting(self) -> str:
        """Return what can be done with what was learned."""
        return (
            f'tuned: {self._learned} waits; {ports.SHOW_TUNED} shows how accurate it is, '
            f'{ports.ACCEPT_TUNED} takes it over, {ports.CANCEL_PASSES} drops it'
        )

    # Services

    def _busy(self) -> str:
        """Return why nothing can begin now, empty if it can."""
        if self._child is None:
            return ''
        return f'busy: {self._said.text}; wait, or call {ports.CANCEL_PASSES}'

    def _on_record(self, request: Any, response: Any) -> Any:
        if busy := self._busy():
            response.message = busy
        elif not (math.isfinite(request.mass) and request.mass > 0 and request.passes > 0):
            given = f'mass {request.mass:g} kg, passes {request.passes}'
            response.message = f'{given}: both must be above 0'
        else:
            numbers = [_number(path) for path in self._folder.glob('passes_*')]
            self._recording = self._folder / f'passes_{max([0, *numbers]) + 1}'
            grams = f'{GRAMS * request.mass:.6f}'
            self._begin(
                'record', '--output', self._recording, '--inputs-only', '--reference', grams,
                '--passes', request.passes, '--namespace', self.get_namespace().strip('/'),
            )  # fmt: skip
            known = {'mass': float(request.mass), 'wanted': int(request.passes)}
            self._tell(DynamicSetting.RECORDING, 'waiting for the first pass', **known)
            response.success, response.bag = True, str(self._recording)
        return response

    def _on_tune(self, request: Any, response: Any) -> Any:
        bags = self._bags()
        if busy := self._busy():
            response.message = busy
        elif not bags:
            response.message = f'{self._folder}: no passes; call {ports.RECORD_PASSES} first'
        else:
            known = self.parameters
            options = ['--params', known.parameters] if known.parameters else []
            options += ['--estimator', known.estimator] if known.estimator != 'best' else []
            self._learned.unlink(missing_ok=True)
            self._begin(
                'tune', *bags, '--output', self._learned, '--overwrite', '--budget', known.budget,
                *options,
            )  # fmt: skip
            self._tell(DynamicSetting.TUNING, f'{known.estimator} on {len(bags)} bags')
            response.success = True
            response.message = f'begun; {ports.DYNAMIC_SETTING.name} says when it is done'
        return response

    def _on_cancel(self, request: Any, response: Any) -> Any:
        """End recording or training, or drop what was learned; passes and parameters stay."""
        response.success = True
        response.message = 'nothing is under way'
        if self._child is not None:
            self._cancelled = True
            self._interrupt(self._child)
            response.message = 'it ends; passes that were weighed are kept'
        elif self._learned.exists():
            self._learned.unlink()
            response.message = f'what was learned is dropped; {self._file} stays as it was'
            self._tell(DynamicSetting.IDLE, response.message)
        return response

    def _candidate(self) -> bytes | None:
        """Return what was learned and waits, None without."""
        try:
            return self._learned.read_bytes()
        except FileNotFoundError:
            return None

    def _on_show(self, request: Any, response: Any) -> Any:
        """Show how accurate the parameters are that wait."""
        learned = self._candidate()
        if learned is None:
            response.message = _NOTHING_WAITS
        else:
            text = learned.decode('utf-8', errors='replace')
            response.success, response.message = True, '\n'.join(accuracy_lines(text))
        return response

    async def _on_accept(self, request: Any, response: Any) -> Any:
        """Take over what was learned, once that is in the audit log."""
        learned = self._candidate()
        if learned is None or self._busy():
            response.message = self._busy() or _NOTHING_WAITS
            return response
        name = self.get_fully_qualified_name()
        value = {'file': str(self._file), 'sha256': hashlib.sha256(learned).hexdigest()}
        if reason := await self.change_record.write(TUNED, name, value):
            response.message = f'{reason}: not taken over'
            return response
        try:
            if self._busy() or self._candidate() != learned:
                raise OutputError('what was learned has changed meanwhile')
            response.message = self._take_over()
            response.success = True
        except (OutputError, OSError) as error:
            response.message = f'not taken over: {error}'
            await self.change_record.write(TUNED, name, response.message)
        return response

    def _on_restart(self, request: Any, response: Any) -> Any:
        """Ask for the line to be started again, with the newest version of the file."""
        if not self.parameters.restart_file:
            response.message = 'this line is started again where it was started, not from here'
            return response
        try:
            Path(self.parameters.restart_file).touch()
        except OSError as error:
            response.message = f'{self.parameters.restart_file}: {error.strerror}'
            return response
        response.success, response.message = True, 'the line ends, and starts again'
        return response

    def _take_over(self) -> str:
        """Make what was learned the newest version of the file, and say so."""
        version = replace_version(self._file, self._learned)
        text = f'{self._file}, version {version}; the line takes it at its next start'
        self._tell(DynamicSetting.IDLE, text)
        self.get_logger().info(text)
        return text

    def _interrupt(self, child: subprocess.Popen[bytes]) -> None:
        """End a child and its own children, which training would wait for.

        SIGINT would be lost on a child that is just starting where it is ignored, as in a shell's
        background.
        """
        if child.poll() is None:
            os.killpg(child.pid, signal.SIGTERM)

    # The child

    def _begin(self, *words: object) -> None:
        self._cancelled = False
        with self._output.open('w') as output, self._errors.open('w') as errors:
            self._child = subprocess.Popen(
                [sys.executable, '-m', 'checkweigher_bringup.cli', *map(str, words)],
                stdin=subprocess.DEVNULL, stdout=output, stderr=errors,
                env={**child_environment(), 'PYTHONUNBUFFERED': '1'},
                process_group=0,  # signals of the terminal reach this node alone, which ends it
            )  # fmt: skip
        self._timer.reset()
        if words[0] == 'tune':
            os.setpriority(os.PRIO_PROCESS, self._child.pid, _LESS_URGENT)

    def _poll(self) -> None:
        """Publish the passes that have come, and the end."""
        if self._child is None:
            return
        status = self._child.poll()
        lines = _lines(self._output) if self._said.state == DynamicSetting.RECORDING else []
        if lines and lines[-1] != self._said.text:
            self._said.text = lines[-1]
            self._said.passes = sum(line.startswith('pass ') for line in lines)
            self._publish()
        if status is not None:
            self._end(status)

    def _end(self, status: int) -> None:
        """Publish the result of a child that has ended."""
        errors, passes = _lines(self._errors), int(self._said.passes)
        was, wanted, mass = self._said.state, int(self._said.wanted), self._said.mass
        self._child, bag, self._recording = None, self._recording, None
        self._timer.cancel()
        if was == DynamicSetting.RECORDING and bag is not None and not passes:
            shutil.rmtree(bag, ignore_errors=True)  # it was made for this, and nothing is in it
        if was == DynamicSetting.TUNING and (status or self._cancelled):
            self._learned.unlink(missing_ok=True)
        if status and not self._cancelled:
            self._tell(DynamicSetting.FAILED, errors[-1] if errors else f'exit status {status}')
        elif was == DynamicSetting.RECORDING:
            text = f'{passes} of {wanted} passes of {GRAMS * mass:g} g recorded'
            self._tell(DynamicSetting.IDLE, text, passes=passes, wanted=wanted, mass=mass)
        elif self._cancelled:
            self._tell(DynamicSetting.IDLE, 'training cancelled')
        else:
            self._tell(DynamicSetting.IDLE, self._waiting())
        if self._said.state == DynamicSetting.FAILED:
            self.warn(self._said.text)
        else:
            self.get_logger().info(self._said.text)

    def destroy_node(self) -> None:
        """End recording or training first."""
        child = getattr(self, '_child', None)
        if child is not None:
            self._interrupt(child)
            try:
                child.wait(_END_PATIENCE)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                child.wait()
        if hasattr(self, '_scratch'):
            self._scratch.close()
        super().destroy_node()


def _number(path: Path) -> int:
    """Return the number of a bag of passes, 0 of what is none."""
    found = re.fullmatch(r'passes_(\d+)', path.name)
    return int(found.group(1)) if found else 0


def _lines(file: Path) -> list[str]:
    text = file.read_text(encoding='utf-8', errors='replace')
    return [line.strip() for line in text.splitlines() if line.strip()]


main = partial(run, DynamicSettingNode)

if __name__ == '__main__':
    main()
