# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Job that weighs one bag: a file that does not depend on the place of the bag, or one line."""

from dataclasses import replace
import io
import json
from pathlib import Path
import shutil

from lines import simulated, write_line
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from checkweigher_core.records import GRAMS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.archive.digest import bag_digest
from checkweigher_recording.bags.reading import read_bag
from checkweigher_validation.accuracy.columns import COLUMNS, ColumnType
from checkweigher_validation.accuracy.results import weigh
from checkweigher_validation.archive import weighing
from checkweigher_validation.archive.program import program
from checkweigher_validation.archive.results_file import read_origin
from checkweigher_validation.archive.weighing import WeighJob, parameters_digest, weigh_bag

PARAMETERS = LineParameters()


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_line(tmp_path_factory.mktemp('bags') / 'shift1', simulated(count=6))


def job(bag: Path, **changes: object) -> WeighJob:
    plain = WeighJob(str(bag), PARAMETERS, None, program())
    return replace(plain, **changes)  # type: ignore[arg-type]


def test_the_file_has_every_value_of_every_item(bag):
    found = weigh_bag(job(bag))

    assert (found.problem, found.summary.items, found.summary.accept) == ('', 6, 6)
    table = pq.read_table(io.BytesIO(found.file))
    metadata = {field.name: field.metadata for field in table.schema}
    assert metadata == {
        column.name: {b'time_zone': b'UTC'}
        if column.kind is ColumnType.TIME
        else {b'unit': column.unit.encode()}
        for column in COLUMNS
    }
    times = [column.name for column in COLUMNS if column.kind is ColumnType.TIME]
    ends = table['t4'].cast(pa.int64()).to_pylist()
    others = [name for name in table.column_names if name not in times]
    rows = table.select(others).to_pylist()
    results = weigh(read_bag(bag), PARAMETERS)
    assert table.column_names == [column.name for column in COLUMNS]
    for row, t4, result in zip(rows, ends, results, strict=True):
        assert row['mass_g'] == GRAMS * result.estimate.mass
        assert t4 == result.t4
        assert (row['decision'], row['reasons']) == ('ACCEPT', [])
        assert (row['lower_limit_g'], row['upper_limit_g']) == (None, None)


def test_the_metadata_say_what_the_results_follow_from(bag, tmp_path):
    (tmp_path / 'file.parquet').write_bytes(weigh_bag(job(bag)).file)

    origin, summary = read_origin(tmp_path / 'file.parquet')

    assert origin.bag_sha256 == bag_digest(bag)
    assert origin.parameters_sha256 == parameters_digest(PARAMETERS)
    assert origin.program == str(program())
    assert summary == weigh_bag(job(bag)).summary
    assert summary.duration_s == pytest.approx(6.7, abs=0.5)


def test_the_bytes_do_not_depend_on_the_place_of_the_bag(bag, tmp_path):
    shutil.copytree(bag, tmp_path / 'elsewhere')
    first = weigh_bag(job(bag))
    assert weigh_bag(job(tmp_path / 'elsewhere')).file == first.file
    assert weigh_bag(job(f'file://{bag}')).file == first.file


def test_a_bag_whose_results_are_there_is_not_weighed_again(bag):
    known = weigh_bag(job(bag, known=bag_digest(bag)))
    assert (known.file, known.summary, known.problem) == (None, None, '')
    assert weigh_bag(job(bag, known='0' * 64)).file is not None


@pytest.mark.parametrize('name', ['none', 'text.mcap', 'file:///nowhere/bag'])
def test_a_bag_that_cannot_be_read_is_one_line(tmp_path, name):
    (tmp_path / 'text.mcap').write_text('no magic bytes in here, but long enough for a footer')
    bag = name if '://' in name else tmp_path / name

    found = weigh_bag(job(bag))

    assert found.file is None
    assert found.problem.startswith(str(bag))
    assert '\n' not in found.problem


def test_a_defect_is_one_line_with_its_place(bag, monkeypatch):
    def defect(*_: object) -> None:
        raise ZeroDivisionError('a defect')

    monkeypatch.setattr(weighing, 'weigh_stretches', defect)
    found = weigh_bag(job(bag))
    assert 'ZeroDivisionError: a defect, at line ' in found.problem
    assert found.problem.endswith('test_weighing.py; report this with the bag')


def test_a_worker_with_another_program_does_not_weigh(bag):
    other = replace(program(), sha256='0' * 64)
    found = weigh_bag(job(bag, program=other))
    assert found.file is None
    assert 'not weighed: the worker runs checkweigher' in found.problem
    assert '(00000000; Python' in found.problem


def test_parameters_that_differ_have_digests_that_differ():
    other = PARAMETERS.with_estimator('mean'), PARAMETERS.with_values({'reject.upper_limit': 1.0})
    assert len({parameters_digest(each) for each in (PARAMETERS, *other)}) == 3


@pytest.mark.parametrize('content', [b'', b'PAR1 and no more', json.dumps({}).encode()])
def test_what_is_no_file_of_results_has_no_origin(tmp_path, content):
    (tmp_path / 'file.parquet').write_bytes(content)
    assert read_origin(tmp_path / 'file.parquet') is None
    assert read_origin(tmp_path / 'none.parquet') is None
