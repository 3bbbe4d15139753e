# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder of a machine: its calibration, trained parameters, recipes and audit log."""

from dataclasses import dataclass
from pathlib import Path
import time

from checkweigher_bringup.errors import UserError
from checkweigher_driver.calibration.file import check_not_installed
from checkweigher_driver.calibration.static_calibration import CalibrationError
from checkweigher_recording.whole_file import OutputError, write_whole

_RECIPES = """\
# The products of this machine. Masses in kg; docs/interfaces.md says what each key means.
products:
  crisps_150g:
    nominal: 0.150      # what the label says
    tare: 0.004         # what the packaging weighs
    lower_limit: TU1    # of directive 76/211/EEC; or a mass
    upper_limit: 0.165
"""
ParameterSets = dict[str, dict[str, object]]  # values by node


@dataclass(frozen=True)
class MachineFolder:
    """Where a line keeps what becomes of its machine; `made` makes it.

    `cell.yaml` is the calibration, `machine.yaml` what was trained, `recipes.yaml` the products,
    `audit.log` who changed what, `passes_N` the recorded passes, `kept` the items that were kept.
    """

    path: Path

    @classmethod
    def made(cls, path: Path) -> 'MachineFolder':
        """Return the folder, made with recipes to begin with if it is new, or raise UserError."""
        path = path.absolute()
        try:
            check_not_installed(path)
            (path / 'kept').mkdir(parents=True, exist_ok=True)
            cls(path).take_restart()  # of a run before
            if not (path / 'recipes.yaml').exists():
                write_whole(path / 'recipes.yaml', _RECIPES)
        except (CalibrationError, OutputError) as error:
            raise UserError(f'--folder {error}') from None
        except OSError as error:
            raise UserError(f'--folder {path}: cannot be made: {error.strerror}') from None
        return cls(path)

    @property
    def kept(self) -> Path:
        """Folder of the items that were kept."""
        return self.path / 'kept'

    def take_restart(self) -> bool:
        """Return whether somebody has asked for the line to be started again, once."""
        try:
            self._restart_file.unlink()
        except FileNotFoundError:
            return False
        return True

    @property
    def _restart_file(self) -> Path:
        return self.path / 'restart'

    def defaults(self) -> ParameterSets:
        """Return what holds unless a parameter file says otherwise: a simulated line runs on."""
        return {'driver': {'simulator.count': 0, 'simulator.start_time': int(time.time())}}

    def files(self, given: Path | None) -> list[Path]:
        """Return the parameter files of the line as they are now, what was trained last."""
        trained = self.path / 'machine.yaml'
        known = [] if given is None else [given]
        return [*known, trained] if trained.exists() else known

    def parameters(self, given: Path | None, *, restarts: bool) -> ParameterSets:
        """Return the values that name the folder to the nodes.

        `restarts` says that who starts the line looks at `take_restart`.
        """
        setting: dict[str, object] = {'folder': str(self.path)}
        if given is not None:
            setting['parameters'] = str(given.absolute())
        if restarts:
            setting['restart_file'] = str(self._restart_file)
        return {
            'driver': {'calibration.file': str(self.path / 'cell.yaml')},
            'product': {
                'recipes': str(self.path / 'recipes.yaml'),
                'audit_log': str(self.path / 'audit.log'),
            },
            'dynamic_setting': setting,
        }
