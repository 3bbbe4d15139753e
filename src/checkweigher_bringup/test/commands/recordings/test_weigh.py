# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command `weigh` for one bag and for many bags, which is resumed and skips broken bags."""

from collections.abc import Callable
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
import os
from pathlib import Path
import shutil
import signal
import subprocess
import threading
import time

from deadly_bags import deadly_environment
from here import refused, run_here
from lines import simulated, write_line
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from running import BAGS, PATIENCE, digests, read_rows, run_command, start_command, wait_for


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Return a folder with two bags in folders of their own."""
    for name in ('may/paper_60', 'june/paper_90'):
        shutil.copytree(BAGS / Path(name).name, tmp_path / 'archive' / name)
    return tmp_path / 'archive'


def weigh_here(*words: object) -> subprocess.CompletedProcess[str]:
    """Weigh any number of bags in the process of the tests."""
    return run_here('weigh', *words, '--jobs', 1)


def test_each_bag_has_a_file_with_the_rows_of_the_csv(archive: Path, tmp_path: Path):
    results = tmp_path / 'results'

    done = run_command('weigh', archive, '--output', results)

    assert (done.returncode, done.stderr) == (0, '')
    lines = done.stdout.splitlines()
    assert [line.partition(',')[0] for line in lines[:2]] == ['1 of 2 bags', '2 of 2 bags']
    assert lines[2] == f'{results}: 2 bags, 0.01 h of signal, 50 items'
    assert list(digests(results)) == [
        'archive/june/paper_90.parquet',
        'archive/may/paper_60.parquet',
    ]
    run_here('weigh', archive / 'may/paper_60', '--csv', tmp_path / 'one.csv')
    rows = read_rows(tmp_path / 'one.csv')
    table = pq.read_table(results / 'archive/may/paper_60.parquet')
    assert table.column_names == list(rows[0])
    assert table.schema.field('t1').type == pa.timestamp('ns')
    assert table.schema.field('t1').metadata == {b'time_zone': b'UTC'}
    times = table['t1'].cast(pa.int64()).to_pylist()
    assert times == [int(row['t1'].replace('.', '')) for row in rows]
    assert [f'{value:.9f}' for value in table['mass_g'].to_pylist()] == [
        row['mass_g'] for row in rows
    ]
    assert table.schema.field('mass_g').metadata == {b'unit': b'g'}
    first, second = read_rows(results / 'summary.csv')
    assert (first['bag'], first['items'], first['accept']) == (
        str(archive / 'june/paper_90'), '25', '25'
    )  # fmt: skip
    assert second['file'] == 'archive/may/paper_60.parquet'


def test_what_is_there_is_kept_as_long_as_bag_and_parameters_are_the_same(
    archive: Path, tmp_path: Path
):
    words = (archive, '--output', tmp_path / 'results')
    weigh_here(*words)
    before = digests(tmp_path / 'results')
    times = {name: (tmp_path / 'results' / name).stat().st_mtime_ns for name in before}

    kept = weigh_here(*words)
    assert kept.stdout.splitlines()[-1].endswith('50 items, 2 bags unchanged')
    for name, written in times.items():
        assert (tmp_path / 'results' / name).stat().st_mtime_ns == written

    other = weigh_here(*words, '--estimator', 'mean')
    assert 'unchanged' not in other.stdout
    assert not set(digests(tmp_path / 'results').values()) & set(before.values())

    weigh_here(*words)
    shutil.rmtree(archive / 'may/paper_60')
    shutil.copytree(BAGS / 'paper_30', archive / 'may/paper_60')
    changed = weigh_here(*words)
    assert changed.stdout.splitlines()[-1].endswith('50 items, 1 bag unchanged')
    after = digests(tmp_path / 'results')
    assert after['archive/june/paper_90.parquet'] == before['archive/june/paper_90.parquet']
    assert after['archive/may/paper_60.parquet'] != before['archive/may/paper_60.parquet']


def test_a_broken_bag_is_told_in_a_line_and_passed_over(archive: Path, tmp_path: Path):
    broken = archive / 'may/paper_60/line_0.mcap'
    broken.write_bytes(broken.read_bytes()[:-100])

    done = weigh_here(archive, '--output', tmp_path / 'results')

    (line,) = done.stderr.splitlines()
    assert line.startswith(f'{broken}: cut off')
    assert line.endswith('; skipped')
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].endswith('25 items, 1 bag skipped')
    assert list(digests(tmp_path / 'results')) == ['archive/june/paper_90.parquet']
    good, bad = read_rows(tmp_path / 'results/summary.csv')
    assert (good['problem'], good['items']) == ('', '25')
    assert (bad['file'], bad['items']) == ('', '')
    assert 'cut off' in bad['problem']


def test_a_place_without_bags_is_a_row_of_the_summary(archive: Path, tmp_path: Path):
    (tmp_path / 'empty').mkdir()
    url = 'http://127.0.0.1:1/plant'

    done = weigh_here(tmp_path / 'empty', archive, url, '--output', tmp_path / 'results')

    assert done.returncode == 1
    empty, unreachable = sorted(done.stderr.splitlines())
    assert empty == f'{tmp_path}/empty: no bag in this folder; skipped'
    assert unreachable.startswith(f'{url}: cannot be read: Cannot connect')
    assert done.stdout.splitlines()[-1].endswith('50 items, 2 bags skipped')
    rows = read_rows(tmp_path / 'results/summary.csv')
    assert [bool(row['problem']) for row in rows] == [True, False, False, True]


def test_results_of_a_bag_that_is_broken_now_go_and_those_of_one_out_of_reach_stay(
    archive: Path, tmp_path: Path
):
    words = (archive / 'may/paper_60', archive / 'june/paper_90', '--output', tmp_path / 'results')
    weigh_here(*words)
    assert list(digests(tmp_path / 'results')) == ['paper_60.parquet', 'paper_90.parquet']
    broken = archive / 'may/paper_60/line_0.mcap'
    broken.write_bytes(broken.read_bytes()[:-100])
    (archive / 'june/paper_90').rename(archive / 'june/elsewhere')

    done = weigh_here(*words)

    assert done.stdout.splitlines()[-1].endswith('0 items, 2 bags skipped')
    assert list(digests(tmp_path / 'results')) == ['paper_90.parquet']


def test_a_folder_with_one_bag_is_weighed_as_the_bag(archive: Path):
    one, folder = (run_here('weigh', archive / name) for name in ('may/paper_60', 'may'))
    assert (folder.returncode, folder.stderr) == (0, '')
    assert folder.stdout == one.stdout


def many_bags(folder: Path, count: int) -> Path:
    folder.mkdir()
    write_line(folder / 'shift00', simulated(count=120, speed=1.0))
    for number in range(1, count):
        shutil.copytree(folder / 'shift00', folder / f'shift{number:02}')
    return folder


def begun(bags: str, output: Path) -> subprocess.Popen[str]:
    """Begin to weigh bags in two processes, and return when the first bag is done."""
    process = start_command('weigh', bags, '--output', output, '--jobs', 2)
    assert process.stdout is not None
    assert process.stdout.readline().startswith('1 of ')
    return process


Copies = Callable[[], list[Path]]


@pytest.fixture
def copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Copies:
    """Return a function that lists the temporary copies of bags."""
    temporary = tmp_path / 'temporary'
    temporary.mkdir()
    monkeypatch.setenv('TMPDIR', str(temporary))
    return lambda: list(temporary.glob('checkweigher-*'))


def test_what_was_broken_off_is_resumed(tmp_path: Path, copies: Copies):
    bags, results = many_bags(tmp_path / 'bags', 8), tmp_path / 'results'
    process = begun(f'file://{bags}', results)
    wait_for(copies)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (130, '')
    assert copies() == []
    there = digests(results)
    assert 0 < len(there) < 8
    assert all(name.startswith('shift') for name in os.listdir(results / 'bags'))

    done = weigh_here(f'file://{bags}', '--output', results)

    assert done.stdout.splitlines()[-1].endswith(
        f'{8 * 120} items, {len(there)} bag{"s" * (len(there) > 1)} unchanged'
    )
    assert len(set(digests(results).values())) == 1


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGKILL])
def test_copies_of_bags_go_with_the_command_or_at_the_next_one(
    tmp_path: Path, copies: Copies, number: signal.Signals
):
    process = begun(f'file://{many_bags(tmp_path / "bags", 12)}', tmp_path / 'results')
    wait_for(copies)
    process.send_signal(number)
    process.communicate(timeout=PATIENCE)
    assert process.returncode == (-number if number == signal.SIGKILL else 128 + number)
    if number == signal.SIGKILL:
        time.sleep(1.0)  # its processes are sent a signal
        run_command('weigh', BAGS / 'paper_60', '--output', tmp_path / 'next', '--jobs', 1)
    assert copies() == []


def test_a_bag_that_kills_its_process_is_a_row_of_the_summary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    bags, results = many_bags(tmp_path / 'bags', 4), tmp_path / 'results'
    (bags / 'shift02').rename(bags / 'deadly')
    for name, value in deadly_environment(tmp_path).items():
        monkeypatch.setenv(name, value)

    done = run_command('weigh', bags, '--output', results, '--jobs', '2')

    assert done.stderr.splitlines() == [
        f'{bags}/deadly: not weighed: the job killed its worker, and again when it was tried '
        'alone, perhaps for lack of memory; skipped'
    ]
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].endswith(f'{3 * 120} items, 1 bag skipped')
    assert len(digests(results)) == 3
    assert [row['bag'] for row in read_rows(results / 'summary.csv') if row['problem']] == [
        f'{bags}/deadly'
    ]


class Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


def test_bags_of_a_web_server_have_the_same_bits(archive: Path, tmp_path: Path):
    weigh_here(archive, '--output', tmp_path / 'here')
    with ThreadingHTTPServer(('127.0.0.1', 0), partial(Silent, directory=str(archive))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f'http://127.0.0.1:{server.server_address[1]}'
        done = weigh_here(url, '--output', tmp_path / 'there')
        one = run_here('weigh', f'{url}/may/paper_60')
        none = refused('weigh', f'{url}/july', '--output', tmp_path / 'none')
        server.shutdown()

    assert (done.returncode, done.stderr) == (0, '')
    here, there = digests(tmp_path / 'here'), digests(tmp_path / 'there')
    assert list(there.values()) == list(here.values())
    assert list(there) == [name.replace('archive', url.rpartition('/')[2]) for name in here]
    assert len(there) == 2
    assert one.stdout == run_here('weigh', archive / 'may/paper_60').stdout
    assert none.startswith(f'checkweigher weigh: {url}/july: cannot be read: ')


@pytest.mark.parametrize(
    ('words', 'text'),
    [
        (['bag', 'none'], 'several bags: add --output DIR'),
        (['empty'], 'empty: no bag in this folder'),
        (['bag', '--jobs', '2'], '--jobs, --scheduler: only with --output DIR'),
        (['bag', '--csv', 'x.csv', '--output', 'results'], '--csv: not with --output'),
        (['bag', '--output', 'file'], 'file: cannot be written: File exists'),
        (['bag', '--output', 'none/results'], 'none/results: cannot be written: No such file'),
    ],
)
def test_what_cannot_be_done_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], text: str
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bag').symlink_to(BAGS / 'paper_60')
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'file').touch()
    before = sorted(tmp_path.iterdir())

    assert text in refused('weigh', *words)

    assert sorted(tmp_path.iterdir()) == before
