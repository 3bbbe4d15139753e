# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The docs and config/line.yaml against the code."""

import math
from pathlib import Path
import re

import make_docs
import pytest
from running import ROOT

from checkweigher_bringup.cli import COMMANDS
from checkweigher_core import changes
from checkweigher_core.parameters import by_node
from checkweigher_core.settings_files import plain
from checkweigher_core.yaml_files import opened
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_production.audit_log import TORN
from checkweigher_production.recipes import Product, read_recipes

PAGES = [*ROOT.glob('*.md'), *ROOT.glob('docs/*.md'), *ROOT.glob('src/*/*.md')]


@pytest.mark.parametrize('path', make_docs.generated(), ids=lambda path: path.name)
def test_what_is_made_of_the_code_is_up_to_date(path: Path):
    content = make_docs.generated()[path]
    assert path.read_text(encoding='utf-8') == content, f'{path} is stale: run `make docs`'


def test_every_table_stands_in_a_page():
    pages = ''.join(path.read_text(encoding='utf-8') for path in make_docs.PAGES)
    assert set(re.findall('<!-- make docs: (.*?) -->', pages)) == set(make_docs.TABLES)


def test_the_comments_of_the_parameter_file_stay():
    written = make_docs.PARAMETER_FILE.read_text(encoding='utf-8')
    begin, end = '    speeds: [', '    product: '
    text = written.replace(begin, f'    # by hand\n{begin}').replace(end, f'    # also\n{end}')
    found = make_docs.parameter_file(text)
    assert found == text
    assert found.count('# by hand') == 1


def test_the_site_has_every_page():
    site = (ROOT / 'packaging/site').read_text(encoding='utf-8')
    listed = set(re.findall(r'docs/(\w+)', site))
    assert listed >= {path.stem for path in ROOT.glob('docs/*.md')}


def test_every_service_and_action_is_documented():
    text = (ROOT / 'docs/services.md').read_text()
    for path in (ROOT / 'src/checkweigher_msgs').glob('[as]*/*.[as]*'):
        assert f'| {path.stem} |' in text, path.stem


def names_in_tables(page: str) -> set[str]:
    """Return what the first cells of the tables of a page name."""
    text = (ROOT / f'docs/{page}.md').read_text()
    cells = re.findall(r'^\|([^|]*)\|', text, re.MULTILINE)
    return {name for cell in cells for name in re.findall('`(.*?)`', cell)}


def test_every_key_of_a_recipe_and_every_kind_of_audit_entry_is_documented():
    kinds = {value for name, value in vars(changes).items() if name.isupper()}
    assert names_in_tables('recipes') == set(plain(Product('any', 1.0)))
    assert names_in_tables('audit_log') >= {*kinds, TORN}


def test_the_method_names_every_estimator():
    assert names_in_tables('method') >= {*ESTIMATORS}


def test_the_recipes_to_begin_with_can_be_read():
    products = read_recipes(ROOT / 'src/checkweigher_bringup/config/recipes.yaml')
    assert products['crisps_150g'].lower_limit == pytest.approx(0.1432, rel=1e-12)


def test_the_parameter_file_says_the_defaults():
    with opened(make_docs.PARAMETER_FILE) as sections:
        found = by_node(sections, make_docs.NODES)
    for node, parameters in make_docs.NODES.items():
        given = {name: found[node].pop(name) for name in list(found[node])}
        assert list(given) == [entry.name for entry in make_docs.own_entries(parameters)]
        assert parameters.from_mapping(given) == parameters()
        for value in given.values():
            assert not (isinstance(value, float) and math.isnan(value))


@pytest.mark.parametrize('command', COMMANDS)
def test_the_docs_show_every_command(command: str):
    text = ''.join(page.read_text() for page in (*PAGES, ROOT / 'bags/README.md'))
    assert re.search(rf'checkweigher {command}\b|`{command}`', text), command


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_files_and_sections_that_the_docs_link_to_are_there(page: Path):
    for target, section in re.findall(r'\]\(([^):#]*)(#[\w-]+)?\)', page.read_text()):
        linked = page.parent / target if target else page
        assert linked.exists(), f'{page} links to {target}'
        if section:
            heads = re.findall(r'^#+ (.*)$', linked.read_text(), re.MULTILINE)
            anchors = {re.sub(r'[^\w -]', '', head.lower()).replace(' ', '-') for head in heads}
            assert section[1:] in anchors, f'{page} links to {target}{section}'


_HEADS = ('| promise ', '| campaign ', '| holds ', '| node ', '|---')


@pytest.mark.parametrize('page', ['safety', 'security'])
def test_each_promise_of_safety_and_security_names_a_test(page: str):
    text = (ROOT / f'docs/{page}.md').read_text(encoding='utf-8')
    if page == 'security':
        text = text.partition('## What holds')[2].partition('## ')[0]
    for line in text.splitlines():
        measured = '` | SIG' in line
        if not line.startswith('|') or line.startswith(_HEADS) or measured:
            continue
        named = re.findall(r'`([\w/]+\.py)::(\w+)`', line)
        assert named, line
        for path, test in named:
            assert f'def {test}(' in (ROOT / path).read_text(encoding='utf-8'), f'{path}::{test}'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_modules_that_the_docs_name_are_there(page: Path):
    modules = [
        path.relative_to(ROOT)
        for folder in ('src', 'test', 'bench', 'docs')
        for path in (ROOT / folder).rglob('*.py')
    ]
    for name in re.findall(r'`(?:python3 )?([\w/]+\.py)`', page.read_text(encoding='utf-8')):
        assert any(f'/{path}'.endswith(f'/{name}') for path in modules), name
