# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `calibrate` and `verify` with a technician at the keyboard."""

import subprocess

from running import start_command


class Dialogue:
    """The command in a process of its own, with a technician at its keyboard."""

    def __init__(self, *arguments: object, command: str = 'calibrate') -> None:
        self.process = start_command(command, *arguments, stdin=subprocess.PIPE)

    def asked(self) -> str:
        """Wait for the next question and return it."""
        assert self.process.stderr is not None
        text = ''
        while not text.endswith('press Enter '):
            sign = self.process.stderr.read(1)
            assert sign, f'ended after {text!r}'
            text += sign
        return text.strip()

    def answer(self, text: str = '') -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f'{text}\n')
        self.process.stdin.flush()

    def end(self) -> tuple[int, str, str]:
        output, errors = self.process.communicate(timeout=60)
        return self.process.returncode, output, errors
