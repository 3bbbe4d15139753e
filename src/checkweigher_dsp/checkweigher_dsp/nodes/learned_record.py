# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a line has learned, in a file that outlives its process."""

import os
from pathlib import Path
import tempfile

from checkweigher_dsp.estimation.learning.learner import LearnedKinds
from checkweigher_dsp.estimation.learning.storage import from_text, to_text
from checkweigher_dsp.state_files import state_file

_NONE = '-'
_MAX_SIZE = 2**25  # bytes


class LearnedRecord:
    """The file of one node; `trouble` says why it cannot be used now, empty if it can.

    A file that cannot be read counts as empty, which does no harm: the line weighs by its estimator
    and learns again.
    """

    def __init__(self, wanted: str, node: str) -> None:
        self.trouble = ''
        self._path: Path | None = None
        try:
            if wanted != _NONE:
                self._path = Path(wanted) if wanted else state_file(f'{node.strip("/")}.learned')
        except RuntimeError as error:  # this user has no home folder
            self._fail(error)

    def read(self) -> LearnedKinds | None:
        """Return what was learned before, None if nothing is known of it."""
        try:
            if self._path is None or not self._path.exists():
                return None
            if self._path.stat().st_size > _MAX_SIZE:
                raise ValueError(f'more than {_MAX_SIZE} bytes')
            return from_text(self._path.read_text(encoding='utf-8'))
        except (OSError, ValueError) as error:
            self._fail(error)
            return None

    def write(self, known: LearnedKinds) -> None:
        """Keep what is known, in place of what was."""
        if self._path is None:
            return
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            number, name = tempfile.mkstemp(prefix=f'.{self._path.name}-', dir=self._path.parent)
            with open(number, 'w', encoding='utf-8') as file:
                file.write(to_text(known))
            os.replace(name, self._path)
            self.trouble = ''
        except OSError as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        text = getattr(error, 'strerror', None) or error
        self.trouble = f'learning.record: {str(self._path)!r}: {text}'
