# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration files: read with file and line, written whole."""

import os
from pathlib import Path

from full_disk import file_size_limit
import pytest

from checkweigher_core.parameters import SettingsError
from checkweigher_core.whole_file import OutputError
from checkweigher_driver.calibration.file import read_calibration, replace_version, write_version
from checkweigher_driver.calibration.static_calibration import CalibrationPoint, calibrate

POINTS = [CalibrationPoint(0.0, 1000.0, 2.0), CalibrationPoint(1.0, 5000.0, 2.0)]
# As `calibrate` writes it; `rate` and the segmenter's are the user's own.
CELL = """\
# Made by checkweigher calibrate, version 3; use it as --params, or as params_file of a launch.
# 2026-05-28T08:00:00+00:00
/**/driver:
  ros__parameters:
    aed:
      rate: 600.0
      counts_per_kg: 4000.0
      zero_counts: 1000.0
/**/segmenter:
  ros__parameters: {min_window: 20}
"""


def cell_of(folder: Path, text: str = CELL) -> Path:
    path = folder / 'cell.yaml'
    path.write_text(text)
    return path


def test_values_are_read_and_those_of_others_stay_when_it_is_written(tmp_path: Path):
    path = cell_of(tmp_path)
    assert read_calibration(path, 'aed') == (4000.0, 1000.0)
    assert write_version(path, 'aed', calibrate(POINTS), POINTS) == 4
    assert read_calibration(path, 'aed') == pytest.approx((4000.0, 1000.0))
    assert 'rate: 600.0' in path.read_text()
    assert 'min_window: 20' in path.read_text()
    assert (tmp_path / 'cell.v3.yaml').read_text() == CELL


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        ('4000.0', 'many', "line 7: driver.aed.counts_per_kg: 'many' is not a number"),
        ('      zero_counts: 1000.0\n', '', 'line 1: driver.aed.zero_counts: None is not a number'),
        ('  ros__parameters: {min', '  parameters: {min', 'line 9: /**/segmenter: has no ros__par'),
        ('    aed:', '    aed: [', 'line 7: bad YAML: '),
    ],
)
def test_a_refusal_has_file_and_line(tmp_path: Path, old: str, new: str, message: str):
    path = cell_of(tmp_path, CELL.replace(old, new))
    with pytest.raises(SettingsError) as caught:
        read_calibration(path, 'aed')
    assert str(caught.value).startswith(f'{path}: {message}')


def test_a_full_disk_leaves_the_calibration_as_it_was(tmp_path: Path):
    path = cell_of(tmp_path)
    with file_size_limit(100), pytest.raises(OutputError):
        write_version(path, 'aed', calibrate(POINTS), POINTS)
    assert path.read_text() == CELL
    assert sorted(os.listdir(tmp_path)) == ['cell.v3.yaml', 'cell.yaml']


def test_an_earlier_version_that_was_edited_is_kept_beside_the_unedited_one(tmp_path: Path):
    path = cell_of(tmp_path)
    assert write_version(path, 'aed', calibrate(POINTS), POINTS) == 4
    edited = CELL + '# edited\n'
    path.write_text(edited)
    assert write_version(path, 'aed', calibrate(POINTS), POINTS) == 5
    assert (tmp_path / 'cell.v3.yaml').read_text() == CELL
    assert (tmp_path / 'cell.v4.yaml').read_text() == edited


def test_each_version_and_its_name_are_on_the_disk(tmp_path: Path, on_disk: list[Path]):
    path = cell_of(tmp_path)
    write_version(path, 'aed', calibrate(POINTS), POINTS)
    assert len(on_disk) == 2
    assert on_disk[1] == tmp_path
    new = tmp_path / 'new'
    new.write_text(CELL)
    assert replace_version(path, new) == 5
    assert on_disk[2:] == [tmp_path]
