# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and state files of each format, also with random damages.

`make soak SOAK_ARGS='-k damaged_file'` tries 20,000 damages, which differ in each run.
"""

from collections import Counter
from collections.abc import Callable
import os
from pathlib import Path
from random import Random
import re
import time

import pytest

from checkweigher_bringup.hosts.description import read_line
from checkweigher_core.parameters import ParameterError
from checkweigher_core.settings_files import plain, read_settings, write_settings
from checkweigher_driver.calibration.file import source_values
from checkweigher_dsp.estimation.learning.learner import LearnedKinds
from checkweigher_dsp.nodes.given_numbers import GivenNumbers
from checkweigher_dsp.nodes.learned_record import LearnedRecord
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.recipes import read_recipes
from checkweigher_validation.verification.plan import EXAMPLE, Plan
from checkweigher_web.access.users import read_users, write_users

EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
FOLDER = Path(__file__).parent / 'settings'
WORDS = b'null "" "x" true [] {} [1] -1 0 1e999 NaN .inf 0150 1:30 1,000 2026-01-01 !!int &a *a'
VALUES = [*WORDS.split(), b'{"a": 1}', b'&a [*a]', b'9' * 30, b'[' * 16_000, b'{"a":' * 4000]
TOKEN = re.compile(rb'"[^"]*"|[-+]?\d[\d.e+-]*|\w+')


def read_learned(path: Path) -> LearnedKinds:
    """Read learned parameters, and check that an accepted fit weighs a load of 1 as 1."""
    record = LearnedRecord(str(path))
    known = record.read()
    if known is None:
        raise ParameterError(record.trouble.removeprefix('learning.record: '))
    for fit in (kind.fit for kind in known.kinds if kind.fit):
        assert fit.weights @ fit.curve == pytest.approx(1, abs=1e-6)
    write_settings(path, known)
    assert plain(read_settings(path, LearnedKinds)) == plain(known)
    return known


def read_all_users(path: Path) -> object:
    users = read_users(path)
    write_users(path, users)
    assert read_users(path) == users
    return users


def read_numbers(path: Path) -> frozenset[int]:
    numbers = GivenNumbers('/lane/segmenter', 0, str(path), 3)
    numbers.close()
    if numbers.trouble:
        raise ParameterError(numbers.trouble)
    return numbers.numbers


def read_parameters(path: Path) -> object:
    return LineParameters.from_file(path), source_values(path, 'aed')


FILES: dict[str, Callable[[Path], object]] = {
    'learned.version_1': read_learned,
    'learned.format_1': read_learned,
    'users.lines': read_all_users,
    'users.format_2': read_all_users,
    'recipes.yaml': read_recipes,
    'hosts.yaml': read_line,
    'machine.yaml': read_parameters,
    'plan.yaml': lambda path: read_settings(path, Plan),
    'items.numbers': read_numbers,
}


def content_of(name: str) -> bytes:
    return EXAMPLE.encode() if name == 'plan.yaml' else (FOLDER / name).read_bytes()


def damaged(data: bytes, random: Random) -> bytes:
    """Return a file with damaged bytes, lines, values, keys or format."""
    first, last = sorted(random.randrange(len(data) + 1) for _ in range(2))
    lines, tokens = data.splitlines(keepends=True), [each.span() for each in TOKEN.finditer(data)]
    (begin, end), other = (random.choice(tokens or [(first, last)]) for _ in range(2))
    line = random.randrange(len(lines) + 1)
    head = random.choice((b'format: 9\n', b'format: -1\n', b'\xef\xbb\xbf'))
    format_9 = re.sub(rb'^(\{?)("(format|version)": \d+, )?', rb'\1"format": 9, ', data)
    return random.choice(
        (
            data[:first] + random.randbytes(1) + data[first + 1 :],
            data[:first] + random.randbytes(8) + data[first:],
            data[:first],
            data[:first] + data[last:],
            data[:last] + data[first:],
            data[:first] + bytes(last - first) + data[last:],
            b''.join(lines[:line] + lines[line + 1 :]),
            b''.join(lines[:line] + lines[line - 1 :]),
            data[:begin] + random.choice(VALUES) + data[end:],
            data[:begin] + data[slice(*other)] + data[end:],
            data[:begin] + b'other_' + data[begin:],
            head + data,
            format_9,
        )
    )


def refusal(name: str, path: Path) -> str:
    """Return the message with which a file is refused, or an empty text."""
    try:
        FILES[name](path)
    except ParameterError as error:
        return str(error)
    return ''


@pytest.mark.parametrize('name', FILES)
def test_a_file_of_each_format_is_read(name: str, tmp_path: Path):
    path = tmp_path / name
    path.write_bytes(content_of(name))
    path.chmod(0o600)
    assert FILES[name](path)


@pytest.mark.parametrize('count', [270, pytest.param(20_000, marks=pytest.mark.soak)])
def test_a_damaged_file_is_read_or_refused_in_one_line(count: int, tmp_path: Path):
    seed = 1 if count == 270 else time.time_ns()
    random, outcomes = Random(seed), Counter[tuple[str, bool]]()
    for number in range(EXAMPLES or count):
        name = [*FILES][number % len(FILES)]
        path, data = tmp_path / name, content_of(name)
        for _ in range(random.choice((1, 1, 1, 2, 3))):
            data = damaged(data, random)
        path.write_bytes(data)
        path.chmod(0o600)
        text = refusal(name, path)
        assert not text or text.startswith(f'{path}: '), (seed, number, text)
        assert text.isprintable(), (seed, number, text)
        outcomes[name, bool(text)] += 1
    print(f'seed {seed}, refused or not:', dict(outcomes))
    assert all(outcomes[name, True] for name in FILES)
