# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Folder with the calibration, trained parameters, recipes and audit log of a machine."""

from dataclasses import dataclass
from pathlib import Path

from rclpy.node import Node

from checkweigher_bringup.errors import UserError
from checkweigher_core.parameters import ParameterError
from checkweigher_core.whole_file import OutputError, write_whole
from checkweigher_driver.calibration.file import check_not_installed
from checkweigher_driver.calibration.static_calibration import CalibrationError
from checkweigher_production.audit_chain import LOG_FILE
from checkweigher_validation.verification.plan import PLANS

_RECIPES = """\
# The products of this machine. Masses are in kg. docs/recipes.md describes the keys.
products:
  crisps_150g:
    nominal: 0.150      # mass on the label
    tare: 0.004         # mass of the packaging
    lower_limit: TU1    # TU1 or TU2 of directive 76/211/EEC, or a mass
    upper_limit: 0.165
"""
# Parameters by node and name.
ParameterSets = dict[str, dict[str, object]]
# Defaults of a line with a folder, which the parameter files override. With the count 0, a
# simulated line has no end.
DEFAULTS: ParameterSets = {'driver': {'simulator.count': 0}}


def own_folder(node: Node, name: str) -> Path:
    """Return the folder that the parameter `folder` of a node names.

    If the name is empty, if there is no such folder, or if the folder belongs to an installed
    package, the node is destroyed and `ParameterError` is raised.
    """
    folder = Path(name)
    try:
        if not name or not folder.is_dir():
            raise CalibrationError(f'{name!r} is not an existing folder')
        check_not_installed(folder)
    except CalibrationError as error:
        text = f'{node.get_name()}.folder: {error}'
        node.destroy_node()
        raise ParameterError(text) from None
    return folder


@dataclass(frozen=True)
class MachineFolder:
    """Folder with the state of a machine.

    The files are the calibration `cell.yaml`, the trained parameters `machine.yaml`, the products
    `recipes.yaml`, the latest item numbers `items.numbers` and `verdicts.numbers`, and the audit
    log `audit.log`. The file `restart` exists while a restart of the line is requested. The folders
    `passes_N` are bags of recorded passes, `kept` contains items that users kept, `batches`
    contains records and reports of batches, `plans` contains verification plans, and
    `verifications` contains a folder for each verification.
    """

    path: Path

    @classmethod
    def made(cls, path: Path) -> 'MachineFolder':
        """Return the folder at `path`. Create the folder and example recipes if they are missing.

        A request for a restart of the line is discarded.

        Raises `UserError` if the folder cannot be used or created.
        """
        path = path.absolute()
        try:
            check_not_installed(path)
            for name in ('kept', PLANS):
                (path / name).mkdir(parents=True, exist_ok=True)
            cls(path).take_restart()  # discard a request for a restart that an earlier run has left
            if not (path / 'recipes.yaml').exists():
                write_whole(path / 'recipes.yaml', _RECIPES)
        except (CalibrationError, OutputError) as error:
            raise UserError(f'--folder {error}') from None
        except OSError as error:
            raise UserError(f'--folder {path}: cannot be created: {error.strerror}') from None
        return cls(path)

    def take_restart(self) -> bool:
        """Return whether a restart of the line was requested, and clear the request."""
        try:
            self._restart_file.unlink()
        except FileNotFoundError:
            return False
        return True

    @property
    def _restart_file(self) -> Path:
        return self.path / 'restart'

    def files(self, given: Path | None) -> list[Path]:
        """Return the parameter file `given`, and the file of the trained parameters if it exists.

        `given` is the parameter file of the user, or None if there is no such file.
        """
        trained = self.path / 'machine.yaml'
        known = [] if given is None else [given]
        return [*known, trained] if trained.exists() else known

    def parameters(self, given: Path | None, *, restarts: bool) -> ParameterSets:
        """Return the parameters that make the nodes use the files of the folder.

        `given` is the parameter file of the user. With `restarts`, users may request a restart of
        the line, and the caller must restart it when `take_restart` returns true.
        """
        setting: dict[str, object] = {'folder': str(self.path)}
        log = str(self.path / LOG_FILE)
        if given is not None:
            setting['parameters'] = str(given.absolute())
        if restarts:
            setting['restart_file'] = str(self._restart_file)
        return {
            'driver': {'calibration.file': str(self.path / 'cell.yaml')},
            'segmenter': {'numbers': str(self.path / 'items.numbers')},
            'reject': {'numbers': str(self.path / 'verdicts.numbers'), 'needs_product': True},
            'product': {
                'recipes': str(self.path / 'recipes.yaml'),
                'audit_log': log,
                'batch_folder': str(self.path / 'batches'),
            },
            'dynamic_setting': setting,
            'verifier': {'folder': str(self.path), 'audit_log': log},
        }
