# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many bags on a Dask cluster of real processes, with the same results as on one machine."""

from collections.abc import Iterator
from functools import partial
import operator
import os
from pathlib import Path
import shutil
import threading
import time

from cluster import Cluster, cluster
from deadly_bags import deadly_environment
from here import refused
from lines import simulated, write_line
import pytest
from running import BAGS, PATIENCE, digests, run_command, start_command

from checkweigher_validation import cluster as on_workers
from checkweigher_validation import jobs
from checkweigher_validation.cluster import on_scheduler
from checkweigher_validation.jobs import ClusterLostError, WorkerLostError, jobs_as_done, run_jobs


@pytest.fixture(scope='module')
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster(tmp_path_factory.mktemp('cluster'), 2) as found:
        yield found


def make_bags(folder: Path, count: int, products: int) -> Path:
    """Write different bags with a number of products each."""
    folder.mkdir()
    for number in range(count):
        line = simulated(count=products, seed=number, speed=(0.5, 1.0, 1.5)[number % 3])
        write_line(folder / f'shift{number:02}', line)
    return folder


def test_a_worker_without_access_to_a_bag_says_so(running: Cluster, tmp_path: Path):
    (tmp_path / 'bags').mkdir()
    shutil.copytree(BAGS / 'paper_90', tmp_path / 'bags/paper_90')
    gone = tmp_path / 'bags/gone.mcap'

    done = run_command(
        'weigh', tmp_path / 'bags', gone, '--output', tmp_path / 'results',
        '--scheduler', running.address,
    )  # fmt: skip

    host = os.uname().nodename
    assert done.stderr.splitlines() == [
        f'on worker {host}: {gone}: there is no such file or folder; skipped'
    ]
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].endswith('25 items, 1 bag skipped')
    assert list(digests(tmp_path / 'results')) == ['bags/paper_90.parquet']


def test_tuning_on_a_cluster_gives_the_same_file(running: Cluster, tmp_path: Path):
    words = ('tune', BAGS / 'paper_60', BAGS / 'paper_90', '--estimator', 'mean', 'tvlpf',
             '--budget', '4', '--output')  # fmt: skip
    assert run_command(*words, tmp_path / 'here.yaml').returncode == 0

    done = run_command(*words, tmp_path / 'there.yaml', '--scheduler', running.address)

    assert (done.returncode, done.stderr) == (0, '')
    here, there = (
        (tmp_path / name).read_text().splitlines() for name in ('here.yaml', 'there.yaml')
    )
    assert here[1] != there[1]  # the time
    del here[1], there[1]
    assert there == here


@pytest.mark.parametrize(
    ('count', 'products'), [(8, 50), pytest.param(60, 600, marks=pytest.mark.soak)]
)
def test_a_cluster_that_loses_a_worker_gives_the_same_bits(
    tmp_path: Path, count: int, products: int
):
    bags = make_bags(tmp_path / 'bags', count, products)
    here, there = tmp_path / 'here', tmp_path / 'there'
    begin = time.monotonic()
    assert run_command('weigh', bags, '--output', here, timeout=1000).returncode == 0
    took = time.monotonic() - begin
    with cluster(tmp_path, 2) as found:
        begin = time.monotonic()
        process = start_command('weigh', bags, '--output', there, '--scheduler', found.address)
        killer = threading.Thread(target=found.kill_busy_worker)
        killer.start()
        said, errors = process.communicate(timeout=10 * PATIENCE)
        print(
            f'\n{count} bags of {products} products: {took:.1f} s here, '
            f'{time.monotonic() - begin:.1f} s on a cluster of 2 workers; the test killed one'
        )
        killer.join()
        assert (process.returncode, errors, found.workers) == (0, '', 1)
    assert said.splitlines()[-1].endswith(f'{count * products} items')
    assert len(digests(here)) == count
    assert digests(there) == digests(here)


@pytest.mark.soak
def test_a_worker_of_another_version_is_refused(tmp_path: Path):
    # The same program, but for a file that another version has changed.
    other = tmp_path / 'other'
    package = Path(__import__('checkweigher_validation').__file__).parent
    shutil.copytree(package, other / 'checkweigher_validation')
    with (other / 'checkweigher_validation/jobs.py').open('a') as file:
        file.write('# changed\n')
    (tmp_path / 'workers').mkdir()
    path = os.pathsep.join([str(other), os.environ.get('PYTHONPATH', '')])

    with cluster(tmp_path / 'workers', 2, {'PYTHONPATH': path}) as found:
        done = run_command(
            'weigh', BAGS / 'paper_60', BAGS / 'paper_90', '--output', tmp_path / 'results',
            '--scheduler', found.address,
        )  # fmt: skip

    (line,) = done.stderr.splitlines()
    assert line.startswith('worker tcp://127.0.0.1:')
    assert 'is not used: the worker runs checkweigher' in line
    assert done.returncode == 0
    assert done.stdout.splitlines()[-1].endswith('50 items')


@pytest.mark.soak
def test_a_cluster_that_ends_is_one_line_and_what_is_done_is_kept(tmp_path: Path):
    bags, results = make_bags(tmp_path / 'bags', 1, 300), tmp_path / 'results'
    for number in range(1, 40):
        shutil.copytree(bags / 'shift00', bags / f'shift{number:02}')
    (tmp_path / 'workers').mkdir()
    with cluster(tmp_path / 'workers', 1) as found:
        process = start_command('weigh', bags, '--output', results, '--scheduler', found.address)
        assert process.stdout is not None
        assert process.stdout.readline().startswith('1 of 40 bags')
        found.scheduler.kill()
        _, errors = process.communicate(timeout=PATIENCE)

    assert process.returncode == 2
    assert errors.splitlines()[-1].startswith('checkweigher weigh: the cluster was lost: ')
    assert 'Traceback' not in errors
    assert 0 < len(digests(results)) < 40


@pytest.mark.parametrize(
    ('address', 'text'),
    [
        ('tcp://127.0.0.1:1', 'there is no Dask scheduler'),
        ('nowhere', 'must be local, or an address such as tcp://HOST:8786'),
    ],
)
def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path, address: str, text: str):
    words = ('weigh', BAGS / 'paper_60', '--output', tmp_path / 'results', '--scheduler', address)
    assert text in refused(*words)
    assert list(tmp_path.iterdir()) == []


def test_without_dask_distributed_there_is_one_line(tmp_path: Path):
    (tmp_path / 'without').mkdir()
    (tmp_path / 'without/distributed.py').write_text("raise ImportError('not installed')\n")
    path = os.pathsep.join([str(tmp_path / 'without'), os.environ.get('PYTHONPATH', '')])

    done = run_command(
        *('weigh', BAGS / 'paper_60', '--output', tmp_path / 'results'),
        *('--scheduler', 'tcp://127.0.0.1:8786'),
        env={**os.environ, 'PYTHONPATH': path},
    )

    assert done.returncode == 2
    assert done.stderr == (
        'checkweigher weigh: --scheduler tcp://127.0.0.1:8786: dask.distributed is not installed; '
        'pip install distributed\n'
    )
    assert not (tmp_path / 'results').exists()


@pytest.fixture(scope='module')
def deadly(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Run a worker that dies at each bag with the name deadly, and is restarted."""
    folder = tmp_path_factory.mktemp('deadly')
    with cluster(folder, 1, deadly_environment(folder), nannies=True) as found:
        yield found


def test_a_cluster_of_one_worker_does_the_work_itself(deadly: Cluster):
    with on_scheduler(deadly.address) as refused:
        done = run_jobs([os.getpid] * 2)
    assert refused == []
    assert len(set(done)) == 1
    assert os.getpid() not in done


def test_a_job_that_keeps_killing_workers_is_lost_and_no_other(deadly: Cluster):
    calls = [partial(operator.neg, 1), partial(os._exit, 9), partial(operator.neg, 2)]
    with on_scheduler(deadly.address):
        done = dict(jobs_as_done(calls))
        assert run_jobs([calls[0], calls[2]]) == [-1, -2]
    lost = done.pop(1)
    assert isinstance(lost, WorkerLostError)
    assert 'the job killed its worker, and again' in str(lost)
    assert done == {0: -1, 2: -2}


@pytest.mark.soak
def test_a_cluster_without_a_worker_left_is_lost(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(jobs, '_LOOK', 0.1)
    monkeypatch.setattr(on_workers, '_PATIENCE', 1.0)
    with (
        cluster(tmp_path, 1) as found,
        on_scheduler(found.address),
        pytest.raises(ClusterLostError, match='has had no worker for 1 s'),
    ):
        list(jobs_as_done([partial(os._exit, 9), partial(operator.neg, 2)]))
