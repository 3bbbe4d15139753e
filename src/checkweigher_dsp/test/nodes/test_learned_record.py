# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The file of what a line has learned, of this version and of others."""

import json
import os
from pathlib import Path

from full_disk import file_size_limit

from checkweigher_dsp.estimation.learning.learner import LearnedKinds
from checkweigher_dsp.nodes.learned_record import LearnedRecord

# As version 1 of the file was written before it had the key `format`.
OLD = (
    '{"version": 1, "basis": "mean {}", "kinds": [{"speed": 0.5, "length": 0.2, "rise": 12, '
    '"items": 3, "passages": [], "fit": null, "recent": [], "change": {"item_id": 9, '
    '"place": NaN, "frequency": 13.0, "factor": 7.5}}]}'
)


def record_of(folder: Path, text: str) -> LearnedRecord:
    (folder / 'learned').write_text(text)
    return LearnedRecord(str(folder / 'learned'), '/identifier')


def read(record: LearnedRecord) -> LearnedKinds:
    found = record.read()
    assert found is not None, record.trouble
    return found


def test_a_file_of_before_is_read_with_defaults_for_what_it_lacks(tmp_path: Path):
    (kind,) = read(record_of(tmp_path, OLD)).kinds
    assert (kind.speed, kind.rise, kind.items) == (0.5, 12, 3)
    assert str(kind.change) == 'the vibration at 13.0 Hz has 7.5 times its power'
    (kind,) = read(record_of(tmp_path, OLD.replace('"items": 3, ', ''))).kinds
    assert kind.items == 0


def test_what_a_newer_version_knows_is_written_again(tmp_path: Path):
    newer = OLD.replace('"version": 1', '"format": 2, "belt": "blue"').replace(
        '"rise"', '"width": 0.1, "rise"'
    )
    record = record_of(tmp_path, newer)
    record.write(read(record))
    record.close()

    content = json.loads((tmp_path / 'learned').read_text())
    assert (content['format'], content['belt'], content['kinds'][0]['width']) == (2, 'blue', 0.1)


def test_what_cannot_be_read_is_named_with_its_line_and_counts_as_nothing(tmp_path: Path):
    record = record_of(tmp_path, OLD.replace('"rise": 12', '"rise": "high"'))
    assert record.read() is None
    assert record.trouble == (
        f"learning.record: {tmp_path / 'learned'}: line 1: kinds.1.rise: 'high' is not a whole "
        'number; write it like 150'
    )


def test_a_full_disk_leaves_the_old_file_whole(tmp_path: Path):
    record = record_of(tmp_path, OLD)
    known = read(record)
    with file_size_limit(20):
        record.write(known)
        record.close()
    assert 'No space left' in record.trouble or 'too large' in record.trouble
    assert (tmp_path / 'learned').read_text() == OLD
    assert os.listdir(tmp_path) == ['learned']
