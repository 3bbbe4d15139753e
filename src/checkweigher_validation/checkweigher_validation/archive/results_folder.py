# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Folder with the results of many bags: one file per bag, and a summary."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path

from checkweigher_core.printable import counted
from checkweigher_core.whole_file import (
    check_folder_of,
    make_output_folder,
    output_error,
    write_whole,
)
from checkweigher_validation.accuracy.columns import rows_as_csv
from checkweigher_validation.archive.results_file import BagSummary, read_origin
from checkweigher_validation.archive.weighing import Weighed, WeighJob, origin_of

SUMMARY = 'summary.csv'
_SECONDS_PER_HOUR = 3600


class ResultsFolder:
    """Results of jobs in the folder `path`, which is created if necessary.

    `jobs` contains the jobs by the names of their result files, without suffix. A bag is not
    weighed again if the folder contains results that were computed from the same bag, with the
    parameters, the lane and the program of its job. The attribute `jobs` is a list of the jobs, in
    which `known` is set for each job with stored results. Raises `OutputError` if the folder
    cannot be used.
    """

    def __init__(self, path: Path, jobs: Mapping[str, WeighJob]) -> None:
        self._path = path
        self._names = {job.bag: f'{name}.parquet' for name, job in jobs.items()}
        self._done: dict[str, Weighed] = {}
        self._before: dict[str, BagSummary] = {}  # summaries of the stored results by bag
        make_output_folder(path, exist_ok=True)
        check_folder_of(path / SUMMARY)
        self.jobs = [replace(job, known=self._known(job)) for job in jobs.values()]

    def file_of(self, bag: str) -> Path:
        """Return the path of the file with the results of a bag."""
        return self._path / self._names[bag]

    def _known(self, job: WeighJob) -> str:
        """Return the digest of the bag of a job if its results are stored, or an empty string."""
        found = read_origin(self.file_of(job.bag))
        if found is None or found[0] != origin_of(job, found[0].bag_sha256):
            return ''
        self._before[job.bag] = found[1]
        return found[0].bag_sha256

    def take(self, weighed: Weighed) -> Weighed:
        """Store the result of a job, and return the result with its summary.

        The earlier results of a damaged bag are removed. If a bag could not be weighed for another
        reason, its earlier results are kept.

        Raises `OutputError` if the results cannot be written.
        """
        file = self.file_of(weighed.bag)
        try:
            if weighed.file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_whole(file, weighed.file)
            elif weighed.broken:
                file.unlink(missing_ok=True)
            elif not weighed.problem:
                weighed = replace(weighed, summary=self._before[weighed.bag])
        except OSError as error:
            raise output_error(file, error) from None
        self._done[weighed.bag] = replace(weighed, file=None)
        return weighed

    @property
    def broken(self) -> int:
        """Number of bags that could not be weighed."""
        return sum(bool(each.problem) for each in self._done.values())

    @property
    def hours(self) -> float:
        """Duration of the signal of all finished bags in h."""
        summaries = (each.summary for each in self._done.values())
        return sum(each.duration_s for each in summaries if each) / _SECONDS_PER_HOUR

    @property
    def progress(self) -> str:
        """Text with the number of finished bags and the duration of their signal."""
        return f'{len(self._done)} of {len(self.jobs)} bags, {self.hours:.2f} h of signal'

    def close(self) -> str:
        """Write the file with the summary, and return one line on all finished bags for the user.

        Raises `OutputError` if the file cannot be written.
        """
        done = [self._done[job.bag] for job in self.jobs if job.bag in self._done]
        self._write_summary(done)
        summaries = {each.bag: each.summary for each in done if each.summary}
        items = sum(each.items for each in summaries.values())
        kept = sum(each is self._before.get(bag) for bag, each in summaries.items())
        parts = [counted(len(done), 'bag'), f'{self.hours:.2f} h of signal', counted(items, 'item')]
        parts += [f'{counted(kept, "bag")} unchanged'] if kept else []
        parts += [f'{counted(self.broken, "bag")} skipped'] if self.broken else []
        return ', '.join(parts)

    def _write_summary(self, done: Iterable[Weighed]) -> None:
        columns = [each.name for each in fields(BagSummary)]
        rows: list[list[object]] = [['bag', 'file', *columns, 'problem']]
        for each in done:
            name = '' if each.problem else self._names[each.bag]
            values = asdict(each.summary) if each.summary else dict.fromkeys(columns)
            values['notes'] = '; '.join(values['notes'] or ())
            rows.append([each.bag, name, *values.values(), each.problem])
        write_whole(self._path / SUMMARY, rows_as_csv(rows))
