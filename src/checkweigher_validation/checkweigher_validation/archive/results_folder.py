# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder with the results of many bags: a file per bag, and the summary of all."""

from collections.abc import Mapping
import csv
from dataclasses import asdict, fields, replace
from io import StringIO
from pathlib import Path

from checkweigher_core.printable import counted
from checkweigher_core.whole_file import check_folder_of, output_error, write_whole
from checkweigher_validation.archive.results_file import BagSummary, read_origin
from checkweigher_validation.archive.weighing import Weighed, WeighJob, origin_of

SUMMARY = 'summary.csv'
_SECONDS_PER_HOUR = 3600


class ResultsFolder:
    """Results of jobs as they are done.

    Parameters
    ----------
    path : Path
        Folder, which is made if need be; what is there of the same bags, parameters and program is
        kept.
    jobs : mapping of WeighJob
        All of them, by the names of their results; `jobs` has them with the digests of the bags
        whose results are there.

    Raises
    ------
    OutputError
        If the folder cannot be made or written to.
    """

    def __init__(self, path: Path, jobs: Mapping[str, WeighJob]) -> None:
        self._path = path
        self._names = {job.bag: name for name, job in jobs.items()}
        self._done: dict[str, Weighed] = {}
        self._before: dict[str, BagSummary] = {}  # of bags whose results are there
        try:
            path.mkdir(exist_ok=True)
        except OSError as error:
            raise output_error(path, error) from None
        check_folder_of(path / SUMMARY)
        self.kept = self.broken = 0
        self.jobs = [replace(job, known=self._known(job)) for job in jobs.values()]

    def file_of(self, bag: str) -> Path:
        """Return the file with the results of a bag."""
        return self._path / f'{self._names[bag]}.parquet'

    def _known(self, job: WeighJob) -> str:
        """Return the digest of the bag whose results are there, made in the same way, or none."""
        found = read_origin(self.file_of(job.bag))
        if found is None or found[0] != origin_of(job, found[0].bag_sha256):
            return ''
        self._before[job.bag] = found[1]
        return found[0].bag_sha256

    def take(self, weighed: Weighed) -> Weighed:
        """Write the results of a bag; return what became of it, with the summary of those kept.

        Results that are there of a bag that is broken now are removed; where the bag was out of
        reach they stay.

        Raises
        ------
        OutputError
            If they cannot be written.
        """
        file = self.file_of(weighed.bag)
        try:
            if weighed.file is not None:
                file.parent.mkdir(parents=True, exist_ok=True)
                write_whole(file, weighed.file)
            elif weighed.broken:
                file.unlink(missing_ok=True)
            elif not weighed.problem:
                self.kept += 1
                weighed = replace(weighed, summary=self._before[weighed.bag])
        except OSError as error:
            raise output_error(file, error) from None
        self.broken += bool(weighed.problem)
        self._done[weighed.bag] = replace(weighed, file=None)
        return weighed

    @property
    def hours(self) -> float:
        """Hours of signal of the bags that are done."""
        summaries = (each.summary for each in self._done.values())
        return sum(each.duration_s for each in summaries if each) / _SECONDS_PER_HOUR

    @property
    def progress(self) -> str:
        """How many bags are done, and how many hours of signal."""
        return f'{len(self._done)} of {len(self.jobs)} bags, {self.hours:.2f} h of signal'

    def close(self) -> str:
        """Write the summary, one row per bag in the order of the jobs; return one line on all.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        text = StringIO()
        writer = csv.writer(text, lineterminator='\n')
        columns = [each.name for each in fields(BagSummary)]
        writer.writerow(['bag', 'file', *columns, 'problem'])
        done = [self._done[job.bag] for job in self.jobs if job.bag in self._done]
        for each in done:
            name = '' if each.problem else f'{self._names[each.bag]}.parquet'
            values = asdict(each.summary) if each.summary else dict.fromkeys(columns)
            values['notes'] = '; '.join(values['notes'] or ())
            writer.writerow([each.bag, name, *values.values(), each.problem])
        write_whole(self._path / SUMMARY, text.getvalue())
        items = sum(each.summary.items for each in done if each.summary)
        parts = [counted(len(done), 'bag'), f'{self.hours:.2f} h of signal', counted(items, 'item')]
        parts += [f'{counted(self.kept, "bag")} as before'] if self.kept else []
        parts += [f'{counted(self.broken, "bag")} passed over'] if self.broken else []
        return ', '.join(parts)
