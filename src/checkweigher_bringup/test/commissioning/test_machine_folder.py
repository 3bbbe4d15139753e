# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Folder of a machine: the files that are created in it, and the parameters for the line."""

from pathlib import Path

import pytest
import rclpy
import yaml

from checkweigher_bringup.commissioning.machine_folder import DEFAULTS, MachineFolder
from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_production.recipes import read_recipes

CALIBRATION = 'calibration.file'


def test_a_new_folder_has_a_recipe_to_begin_with_and_keeps_what_is_changed(tmp_path: Path):
    folder = MachineFolder.made(tmp_path / 'lane1' / 'scale')
    recipes = folder.path / 'recipes.yaml'
    assert list(read_recipes(recipes)) == ['crisps_150g']
    recipes.write_text(yaml.safe_dump({'products': {'tea': {'nominal': 0.1}}}))
    MachineFolder.made(folder.path)
    assert list(read_recipes(recipes)) == ['tea']


def test_what_the_nodes_keep_is_in_the_folder(tmp_path: Path):
    folder = MachineFolder.made(tmp_path)
    values = folder.parameters(None, restarts=False)
    assert values['verifier'] == {
        'folder': str(tmp_path), 'audit_log': values['product']['audit_log']
    }  # fmt: skip
    assert values['product']['batch_folder'] == str(tmp_path / 'batches')
    assert values['reject']['needs_product'] is True
    assert (tmp_path / 'plans').is_dir()


def test_what_was_trained_overrules_the_file_of_the_user(tmp_path: Path):
    folder, given = MachineFolder.made(tmp_path), tmp_path / 'line.yaml'
    assert folder.files(given) == [given]
    (tmp_path / 'machine.yaml').touch()
    assert folder.files(given) == [given, tmp_path / 'machine.yaml']
    assert folder.files(None) == [tmp_path / 'machine.yaml']


def test_a_new_start_is_taken_once_and_not_one_that_was_asked_of_a_line_before(tmp_path: Path):
    folder = MachineFolder.made(tmp_path)
    values = folder.parameters(None, restarts=True)['dynamic_setting']
    asked = Path(str(values['restart_file']))
    asked.touch()
    assert MachineFolder.made(tmp_path).take_restart() is False
    asked.touch()
    assert folder.take_restart() is True
    assert folder.take_restart() is False
    assert 'restart_file' not in folder.parameters(None, restarts=False)['dynamic_setting']


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path):
    (tmp_path / 'file').touch()
    for path in (tmp_path / 'file', tmp_path / 'file' / 'inside'):
        with pytest.raises(UserError, match=r'--folder .*file') as refused:
            MachineFolder.made(path)
        assert '\n' not in str(refused.value)


def test_a_file_that_names_the_lane_does_not_overrule_the_folder(tmp_path: Path):
    folder = MachineFolder.made(tmp_path)
    first, dumped, last = (tmp_path / f'{name}.yaml' for name in ('first', 'dumped', 'last'))
    write_parameter_file(first, DEFAULTS)
    dumped.write_text(yaml.safe_dump({'/lane1/driver': {'ros__parameters': {CALIBRATION: ''}}}))
    write_parameter_file(last, folder.parameters(dumped, restarts=False), 'lane1')
    files = (word for file in (first, dumped, last) for word in ('--params-file', str(file)))
    context = rclpy.Context()
    rclpy.init(args=['--ros-args', *files], context=context)
    try:
        driver = rclpy.create_node('driver', namespace='lane1', context=context)
        used = driver.declare_parameter(CALIBRATION, '').value
        driver.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)
    assert used == str(tmp_path / 'cell.yaml')
