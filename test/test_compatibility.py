# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What version 0.1.0 wrote, and its commands: docs/compatibility.md.

`version_0_1_0` has files that its programs wrote (66f71713^), and the options of its commands. The
bags in `bags/` are of the same version.
"""

import argparse
import json
from pathlib import Path
import re
import shutil

from here import refused, run_here
import pytest
from running import BAGS, ROOT, read_rows

from checkweigher_bringup.cli import build_parser
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.audit_log import AuditLog, read_log
from checkweigher_production.recipes import read_recipes

FOLDER = ROOT / 'test/version_0_1_0'
COMMANDS = json.loads((FOLDER / 'commands.json').read_text(encoding='utf-8'))
PAGE = (ROOT / 'docs/compatibility.md').read_text(encoding='utf-8')
RETIRED = ['min_belt_speed', 'debounce_time', 'edge_lateness', 'product']  # of reject


@pytest.mark.parametrize('command', COMMANDS)
def test_each_command_has_the_options_that_it_had(command: str):
    parser = build_parser()
    choices = next(
        action.choices
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
    )
    options = {option for each in choices[command]._actions for option in each.option_strings}
    assert set(COMMANDS[command]) <= options


def test_bags_are_weighed_with_trained_parameters(tmp_path: Path):
    csv = tmp_path / 'masses.csv'
    done = run_here(
        *('weigh', BAGS / 'paper_60', '--params', FOLDER / 'machine.yaml', '--csv', csv)
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert [row['decision'] for row in read_rows(csv)] == 25 * ['ACCEPT']


def test_an_audit_log_is_whole_and_goes_on(tmp_path: Path):
    for name in ('audit.log', 'audit.log.head'):
        shutil.copyfile(FOLDER / name, tmp_path / name)
    with AuditLog(tmp_path / 'audit.log') as log:
        assert [entry.kind for entry in log.entries] == ['parameter', 'recipe']
        log.append('2026-05-29T06:00:00.000000+00:00', '/product', 'run', 'line', None, 'begun')
    found = read_log(tmp_path / 'audit.log')
    assert found.whole
    assert [entry.who for entry in found.entries] == [None, None, 'graph:/product']


def test_recipes_have_the_limits_that_they_had_to_the_rounding_of_the_directive():
    products = read_recipes(FOLDER / 'recipes.yaml')
    limits = {name: (each.lower_limit, each.upper_limit) for name, each in products.items()}
    # Directive 76/211/EEC: 4.5 % of 150 g, rounded up from 6.75 g, and twice 4.5 g of 75 g.
    assert limits == {
        'crisps_150g': (pytest.approx(0.150 - 0.0068), 0.165),
        'crisps_75g': (pytest.approx(0.075 - 2 * 0.0045), 0.090),
    }


def test_a_parameter_that_is_gone_is_refused_by_name_and_the_others_count(tmp_path: Path):
    path = tmp_path / 'line.yaml'
    text = (FOLDER / 'line.yaml').read_text(encoding='utf-8')
    text = text.replace('verdict_margin: 0.05', 'verdict_margin: 0.25')
    for name in RETIRED:
        path.write_text(text, encoding='utf-8')
        said = refused('weigh', BAGS / 'paper_60', '--params', path)
        assert f'reject.{name}: no such parameter' in said
        assert f'`reject.{name}`' in PAGE
        section, reject, rest = text.partition('/**/reject:')
        text = section + reject + re.sub(rf'\n    {name}: .*(\n     +#.*)*', '', rest, count=1)
    path.write_text(text, encoding='utf-8')
    assert LineParameters.from_file(path).reject.verdict_margin == 0.25
