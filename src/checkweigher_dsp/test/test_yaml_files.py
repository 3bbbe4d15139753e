# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""YAML of others: the values, or one line at once."""

from pathlib import Path
import subprocess
import sys
import time

import pytest

from checkweigher_dsp.yaml_files import parse_yaml

MEMORY = 100 << 20  # bytes, of an interpreter that reads the file


def refused(text: str) -> str:
    """Return the line that refuses a YAML text; none takes a second."""
    began = time.process_time()
    with pytest.raises(ValueError, match=r'.') as caught:
        parse_yaml(text)
    assert time.process_time() - began < 1
    line = str(caught.value)
    assert '\n' not in line
    assert len(line) < 200
    return line


def multiplied(levels: int, times: int) -> str:
    """Return YAML whose aliases stand for times ** levels values."""
    lines = ['a0: &a0 {x: 1}']
    for level in range(1, levels + 1):
        entries = ', '.join(f'k{number}: *a{level - 1}' for number in range(times))
        lines.append(f'a{level}: &a{level} {{{entries}}}')
    return '\n'.join(lines)


def test_plain_values_come_as_they_are():
    text = 'a: {b: [1, 2.5, .nan, true, null], c: "x"}\nd: &e {f: 1}\ng: *e\n'

    content = parse_yaml(text)

    assert content['a']['b'][:2] == [1, 2.5]
    assert content['a']['b'][3:] == [True, None]
    assert content['g'] == {'f': 1}


def test_a_mapping_may_be_merged_into_another():
    assert parse_yaml('a: &a {b: 1, c: 2}\nd: {<<: *a, c: 3}')['d'] == {'b': 1, 'c': 3}


@pytest.mark.parametrize(
    ('text', 'says'),
    [
        ('a: 1\na: 2', 'line 1: a stands twice'),
        ('x:\n  a: {b: 1, "b": 2}', 'line 2: b stands twice'),
        ('&a\nx: *a', 'within its own anchor'),
        ('x: &a [1, *a]', 'within its own anchor'),
        ('[' * 10**6, 'nested deeper than 20'),
        ('{a: ' * 2000 + '1' + '}' * 2000, 'nested deeper than 20'),
        ('\n'.join(' ' * n + 'a:' for n in range(500)), 'nested deeper than 20'),
        (multiplied(12, 9), 'more than 100000 values'),
        (multiplied(17, 2), 'more than 100000 values'),
        ('a: &a {b: 1}\n' + 'c: {<<: [' + '*a, ' * 100_001 + ']}', 'more than 100000 values'),
        ('a: ' + '9' * 6000, 'a number of 6000 characters'),
        ('a: 0x' + 'f' * 6000, 'a number of 6002 characters'),
        ('a: 1' + ':59' * 3000, 'a number of 9001 characters'),
        ('a: "\\ud800"', 'half a surrogate pair'),
        ('a: !!python/object/apply:os.system [ls]', 'could not determine a constructor'),
        ('a: 2001-99-99', 'month'),
        ('a: [', 'line 1: '),
        ('a: \x07', 'special characters'),
    ],
)
def test_what_is_refused(text: str, says: str):
    assert says in refused(text)


def test_aliases_take_no_memory(tmp_path: Path):
    file = tmp_path / 'bomb.yaml'
    file.write_text(multiplied(12, 9))
    script = (
        'import sys; from pathlib import Path\n'
        'from checkweigher_dsp.yaml_files import read_yaml\n'
        'try:\n    read_yaml(Path(sys.argv[1]))\nexcept ValueError:\n'
        '    print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])'
    )
    words = [sys.executable, '-c', script, str(file)]

    done = subprocess.run(words, capture_output=True, text=True, check=True)

    assert int(done.stdout) << 10 < MEMORY
