# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the start of a line must not wait for."""

import subprocess
import sys


def test_a_line_starts_without_what_only_a_source_or_a_report_needs():
    code = """
import sys
import checkweigher_bringup.line
heavy = {'scipy', 'matplotlib', 'rosbags', 'mcap', 'pymodbus', 'serial', 'gpiod'}
print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)

    assert done.stdout.strip() == '[]'
