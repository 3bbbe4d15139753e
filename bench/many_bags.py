# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hours of signal a second by 1 and more workers, and the share that only one process does.

    python3 bench/many_bags.py --bags 16 --products 600     # after source setup/environment

Each turn weighs the same bags into a new folder by a number of processes of this machine. The
serial share is the work of the command beside its jobs, measured with a folder that has all results
except the digests. It limits the gain of any number of workers (Amdahl's law), which is computed.
"""

import argparse
from pathlib import Path
import resource
import shutil
from tempfile import TemporaryDirectory
import time

from batch import run

from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.writing import write_bag
from checkweigher_recording.simulation.simulator import Simulation, SimulationParameters
from checkweigher_validation.archive.program import program
from checkweigher_validation.archive.results_folder import ResultsFolder
from checkweigher_validation.archive.weighing import WeighJob, weigh_bag

_ON_PAPER = (1, 2, 4, 8, 16, 32, 64, 128, 256)


def make_bags(folder: Path, count: int, products: int) -> float:
    """Write so many bags; return the hours of their signal."""
    folder.mkdir()
    simulation = Simulation(SimulationParameters(count=products))
    write_bag(folder / 'bag000', simulation.load_cell, simulation)
    for number in range(1, count):
        shutil.copytree(folder / 'bag000', folder / f'bag{number:03}')
    return count * (products * 0.66 + 3.0) / 3600  # at 1 m/s


def command(bags: Path, output: Path, jobs: int) -> float:
    """Return how long the command takes, s."""
    begin = time.monotonic()
    run(['weigh', str(bags), '--output', str(output), '--jobs', str(jobs)])
    return time.monotonic() - begin


def job_and_rest(bags: Path, output: Path) -> tuple[float, float]:
    """Return the processor time of the job of a bag, and of the other work for the bag, s."""
    jobs = [WeighJob(str(bag), LineParameters(), None, program()) for bag in sorted(bags.iterdir())]
    weigh_bag(jobs[0])  # fills caches
    begin = time.process_time()
    found = [weigh_bag(job) for job in jobs[:4]]
    job = (time.process_time() - begin) / len(found)
    begin = time.process_time()
    folder = ResultsFolder(output, {Path(job.bag).name: job for job in jobs[:4]})
    for each in found:
        folder.take(each)
    folder.close()
    return job, (time.process_time() - begin) / len(found)


def main() -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').partition('\n')[0])
    parser.add_argument('--bags', type=int, default=16)
    parser.add_argument('--products', type=int, default=600, help='of each bag')
    parser.add_argument('--workers', type=int, nargs='+', default=[1, 2])
    parser.add_argument('--turns', type=int, default=3)
    given = parser.parse_args()
    with TemporaryDirectory(prefix='checkweigher-') as name:
        folder = Path(name)
        hours = make_bags(folder / 'bags', given.bags, given.products)
        print(f'{given.bags} bags, {hours:.2f} h of signal in all')
        for workers in given.workers:
            times = [
                command(folder / 'bags', folder / f'results{workers}_{turn}', workers)
                for turn in range(given.turns)
            ]
            best = min(times)
            shown = ', '.join(f'{one:.1f}' for one in times)
            print(f'{workers} workers: {shown} s; at best {hours / best:.3f} h of signal a second')
        job, rest = job_and_rest(folder / 'bags', folder / 'measured')
        rate = hours / given.bags / job
        print(f'a bag: {job:.3f} s of its job, {1e3 * rest:.2f} ms beside it ({rest / job:.2%})')
        print(f'memory of a job: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10} MB')
        for workers in _ON_PAPER:
            gained = min(workers, job / rest)  # the one process and the workers go on side by side
            print(f'{workers:4} workers on paper: {gained * rate:.3f} h of signal a second')


if __name__ == '__main__':
    main()
