# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""File with the learned state of a node, which the next process of the node reads."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from checkweigher_core.parameters import SettingsError
from checkweigher_core.settings_files import read_settings, write_settings
from checkweigher_core.state_files import make_folder, state_file
from checkweigher_dsp.estimation.learning.learner import LearnedKinds

NONE = '-'


class LearnedRecord:
    """File with the learned state of a node.

    A file that cannot be read is ignored, because the estimator can weigh without the learned
    state. `wanted` is the path of the file, empty for a file that is named after the `node`, or
    ``-`` for no file.
    """

    def __init__(self, wanted: str, node: str = '') -> None:
        self.trouble = ''  # reason why the file cannot be used, or empty
        self._path: Path | None = None
        # Write the file in a thread, so that the processing of items does not wait for the disk.
        self._writer = ThreadPoolExecutor(1, 'learned record')
        try:
            if wanted != NONE:
                self._path = Path(wanted) if wanted else state_file(f'{node.strip("/")}.learned')
        except RuntimeError as error:  # `state_file` fails if the user has no home folder.
            self._fail(error)

    def read(self) -> LearnedKinds | None:
        """Return the content of the file, or None if it does not exist or cannot be read.

        If the file exists but cannot be read, `trouble` is set.
        """
        try:
            if self._path is not None and self._path.exists():
                return read_settings(self._path, LearnedKinds)
        except (OSError, SettingsError) as error:
            self._fail(error)
        return None

    def write(self, known: LearnedKinds, *, now: bool = False) -> None:
        """Replace the content of the file in the background.

        If `now` is true, wait until the file is written. If the node uses no file, nothing is
        written. If the file cannot be written, `trouble` is set.
        """
        if self._path is not None:
            written = self._writer.submit(self._write, self._path, known)
            if now:
                written.result()

    def close(self) -> None:
        """Wait until the file is written, and end the thread that writes it."""
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
