# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""File of the learned state of a line, which outlives its process."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from checkweigher_core.parameters import SettingsError
from checkweigher_core.settings_files import read_settings, write_settings
from checkweigher_core.state_files import make_folder, state_file
from checkweigher_dsp.estimation.learning.learner import LearnedKinds

NONE = '-'


class LearnedRecord:
    """File of the learned state of a node.

    A file that cannot be read counts as empty. This does no harm, because the line weighs by its
    estimator and learns again.

    Parameters
    ----------
    wanted : str
        Path of the file; if empty, the file is named after the node; ``-`` for no file.
    node : str
        Full name of the node.

    Attributes
    ----------
    trouble : str
        Reason why the file cannot be used now, empty if it can.
    """

    def __init__(self, wanted: str, node: str = '') -> None:
        self.trouble = ''
        self._path: Path | None = None
        self._writer = ThreadPoolExecutor(1, 'learned record')  # so that no item waits for a disk
        try:
            if wanted != NONE:
                self._path = Path(wanted) if wanted else state_file(f'{node.strip("/")}.learned')
        except RuntimeError as error:  # the user has no home folder
            self._fail(error)

    def read(self) -> LearnedKinds | None:
        """Return the content of the file, None if there is none."""
        try:
            if self._path is not None and self._path.exists():
                return read_settings(self._path, LearnedKinds)
        except (OSError, SettingsError) as error:
            self._fail(error)
        return None

    def write(self, known: LearnedKinds, *, now: bool = False) -> None:
        """Replace the content of the file, in the background or with `now` before returning."""
        if self._path is not None:
            written = self._writer.submit(self._write, self._path, known)
            if now:
                written.result()

    def close(self) -> None:
        """Wait until the content is in the file."""
        self._writer.shutdown()

    def _write(self, path: Path, known: LearnedKinds) -> None:
        try:
            make_folder(path.parent)
            write_settings(path, known)
            self.trouble = ''
        except OSError as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        place = '' if isinstance(error, SettingsError) else f'{self._path}: '
        text = getattr(error, 'strerror', None) or error
        self.trouble = f'learning.record: {place}{text}'
