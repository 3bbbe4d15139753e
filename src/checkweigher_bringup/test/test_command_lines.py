# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile command lines: a status, a short line, nothing half-written, no device replaced."""

from collections import Counter
import os
from pathlib import Path
import random
import stat
import subprocess
import sys
import time

from hostile_bags import zeros_packed
import pytest
from running import BAGS, PATIENCE

LONGEST = 1000  # characters of what is said
MOST_MEMORY = 1000  # MB
BAG = str(BAGS / 'paper_90')
NUMBERS = ('nan', 'inf', '-1', '0', '1e308', '1e-300', '1' * 6000, 'x', '\x1b[31m', '')
DOCUMENTS = {
    'self.yaml': '&a\n/**/reject: *a\n',
    'deep.yaml': '/**/reject:\n  ros__parameters: ' + '{a: ' * 3000 + '1' + '}' * 3000,
    'digits.yaml': '/**/reject:\n  ros__parameters: {lower_limit: 0x' + 'f' * 6000 + '}\n',
    'twice.yaml': '/**/reject:\n  ros__parameters: {lower_limit: 0.1, lower_limit: 0.2}\n',
    'text.yaml': '/**/reject:\n  ros__parameters: {lower_limit: "' + 'x' * 380_000 + '"}\n',
    'escapes.yaml': '/**/reject:\n  ros__parameters: {"\\e[31m\\a": 1}\n',
    'large.yaml': '# ' + 'x' * 3_000_000,
    'log.csv': 'a,b\n1,2\n' + '"' + 'x' * 200_000,
    'digits.json': '{"ftc1": [[' + '9' * 5000 + ', 1]]}',
    'brackets.json': '[' * 100_000,
    'log.head': '[' * 100_000,
}


@pytest.fixture(scope='module')
def places(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of hostile files, pipes, links and, where they can be made, devices."""
    folder = tmp_path_factory.mktemp('places')
    for name, text in DOCUMENTS.items():
        (folder / name).write_text(text)
    names = ['a0: &a0 {x: 1}']
    for level in range(1, 12):
        aliases = ', '.join(f'k{number}: *a{level - 1}' for number in range(9))
        names.append(f'a{level}: &a{level} {{{aliases}}}')
    (folder / 'aliases.yaml').write_text('\n'.join(names))
    (folder / 'zeros.mcap').write_bytes(zeros_packed(40 << 20))
    os.mkfifo(folder / 'pipe.mcap')
    (folder / 'zero.mcap').symlink_to('/dev/zero')
    (folder / 'circle').symlink_to('circle')
    (folder / 'folder').mkdir()
    (folder / '\x1b[31m\x07').write_text('')
    try:
        for name, minor in (('null', 3), ('full', 7)):
            os.mknod(folder / name, 0o666 | stat.S_IFCHR, os.makedev(1, minor))
        (folder / 'linked').symlink_to('null')
    except PermissionError:
        pass  # for root alone
    return folder


def line_of(chance: random.Random, places: Path, out: Path) -> list[str]:
    """Return the words of a hostile command line that ends by itself."""
    listed = [str(path) for path in sorted(places.iterdir())]
    file, number = chance.choice(listed), chance.choice(NUMBERS)
    target = chance.choice([*listed, str(out / 'new'), str(out / 'none' / 'new'), '/proc/new'])
    bag = chance.choice([BAG, file])
    lines: list[list[str]] = [
        ['weigh', file],
        ['weigh', BAG, '--params', file],
        ['weigh', BAG, '--csv', target, '--overwrite'],
        ['weigh', BAG, '--estimator', number],
        ['weigh', BAG, '--lane', number],
        ['replay', file],
        ['replay', BAG, '--rate', chance.choice(['nan', 'inf', '-1', 'x'])],
        ['replay', BAG, '--params', file],
        ['tune', file, '--output', target],
        ['tune', BAG, '--output', target, '--budget', number, '--overwrite', '--jobs', '1',
         '--estimator', 'mean'],
        ['evaluate', BAG, '--html', target, '--csv', str(out / 'table'), '--overwrite',
         '--jobs', '1', '--params', chance.choice([file, str(places / 'none')])],
        ['evaluate', bag, '--html', target, '--overwrite', '--jobs', '1'],
        ['simulate', '--speed', number, '--mass', '100', '--output', str(out / 'bag')],
        ['simulate', '--speed', '60', '--mass', number, '--count', '2', '--output', target],
        ['simulate', '--speed', '60', '--mass', '9', '--lead-in', number,
         '--count', '2', '--output', str(out / 'bag')],
        ['import', file, '--output', target],
        ['import', str(places / 'log.csv'), '--edges', file, '--slope', number,
         '--sample-rate', '1000', '--signal', 'a', '--output', str(out / 'bag')],
        ['recover', file, '--output', target],
        ['audit', file],
        ['record', '--duration', number, '--output', str(out / 'bag')]
        if number not in ('1e308', '1e-300', '1' * 6000) else ['record', '--output', file],
        ['run', '--params', file, '--source', number],
        ['calibrate', '--zero', '--output', target, '--source', 'simulator', '--params', file],
        [number, file],
        ['echo', '--count', chance.choice(['nan', '0', '-1', 'x'])],
    ]  # fmt: skip
    return chance.choice(lines)


def try_line(words: list[str], out: Path) -> tuple[str, int]:
    """Run a command line; return what is wrong, empty if nothing is, and the memory in MB."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'checkweigher_bringup.cli', *words],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=out,
    )  # fmt: skip
    memory, end = 0, time.monotonic() + 2 * PATIENCE
    while process.poll() is None:
        try:
            said, errors = process.communicate(timeout=0.05)
        except subprocess.TimeoutExpired:
            status = Path(f'/proc/{process.pid}/status').read_text()
            if 'VmHWM:' in status:
                memory = max(memory, int(status.split('VmHWM:')[1].split()[0]) // 1000)
            if time.monotonic() > end:
                process.kill()
                process.communicate()
                return 'hangs', memory
        else:
            break
    else:
        said, errors = process.communicate()
    text = errors.decode(errors='replace')
    lines = text.strip().splitlines()
    if process.returncode not in (0, 1, 2):
        return f'status {process.returncode}: {text[-300:]}', memory
    if 'Traceback' in text or len(lines) > 1 + ('no check sums' in text):
        return f'says {text[-1000:]}', memory
    if any(not line.isprintable() or len(line) > LONGEST for line in lines):
        return f'not printable or too long: {text[:300]!r}', memory
    if any(not each.isprintable() for each in said.decode(errors='replace').splitlines()):
        return f'prints {said[:300]!r}', memory
    if process.returncode == 2 and (left := [*out.iterdir()]):
        return f'left {left}', memory
    return ('' if memory < MOST_MEMORY else f'{memory} MB'), memory


def kinds(places: Path) -> dict[str, int]:
    """Return the kind of each file, pipe, device and link."""
    return {path.name: stat.S_IFMT(path.lstat().st_mode) for path in places.iterdir()}


def campaign(places: Path, folder: Path, count: int, seed: int) -> list[str]:
    """Try so many command lines, print the counts, and return what did not hold."""
    chance = random.Random(seed)
    outcomes: Counter[str] = Counter()
    bad = []
    largest = 0
    before = kinds(places)
    for number in range(count):
        out = folder / str(number) / 'out'
        out.mkdir(parents=True)
        words = line_of(chance, places, out)
        wrong, memory = try_line(words, out)
        largest = max(largest, memory)
        after = kinds(places)
        for name in set(before) - {'new'}:
            if after.get(name) != before[name]:
                wrong += f' {name} was replaced'
        before = after
        outcomes['not held' if wrong else 'held'] += 1
        if wrong:
            bad.append(f'{[word[:80] for word in words]}: {wrong}')
    print(f'\ncommand lines: {count} tried, {dict(outcomes)}, largest memory {largest} MB')
    return bad


def test_hostile_command_lines(places: Path, tmp_path: Path):
    assert not campaign(places, tmp_path, 8, 1)


@pytest.mark.soak
@pytest.mark.parametrize('seed', [2, 3])
def test_many_hostile_command_lines(places: Path, tmp_path: Path, seed: int):
    assert not campaign(places, tmp_path, 100, seed)
