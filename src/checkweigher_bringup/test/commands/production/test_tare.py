# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tare control: what a sample of empty packages says, and what it changes in the recipe."""

from dataclasses import replace
from pathlib import Path

from here import run_here
import numpy as np
import pytest

from checkweigher_production.audit_log import read_log
from checkweigher_production.recipes import read_recipes

RECIPES = """products:
  crisps:               # the best
    nominal: 0.150
    tare: 0.010         # as the supplier says
  nuts: {nominal: 0.2}
"""
GOOD = np.linspace(9.6, 11.2, 25).round(3)  # g; more than 5 % of 150 g


@pytest.fixture(name='recipes')
def _recipes(tmp_path: Path) -> Path:
    path = tmp_path / 'recipes.yaml'
    path.write_text(RECIPES)
    return path


def control(recipes: Path, product: str, masses: object, *more: str) -> tuple[int, str]:
    words = ('--product', product, '--masses', *masses, '--who', 'anna', *more)
    done = run_here('tare', recipes, *words)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.parametrize(
    ('masses', 'status', 'said'),
    [
        (GOOD[:24], 1, 'NOT the tare: 24 empty packages, 25 are needed'),
        # A quarter of the tolerable negative error of 150 g, 6.8 g, is 1.7 g.
        (10.4 + 4 * (GOOD - 10.4), 1, 'is above a quarter of the tolerable negative error, 1.700'),
        (4.0 + 4 * (GOOD - 10.4), 0, 'the mean may be the tare'),  # below 5 % of 150 g
        (GOOD, 0, f'mean {np.mean(GOOD):.3f} g, standard deviation {np.std(GOOD, ddof=1):.3f} g'),
    ],
)
def test_a_sample_is_judged_and_recorded(recipes: Path, masses: np.ndarray, status: int, said: str):
    found, told = control(recipes, 'crisps', masses)
    assert (found, said in told) == (status, True), told
    assert recipes.read_text() == RECIPES
    (entry,) = read_log(recipes.with_name('audit.log')).entries
    assert (entry.kind, entry.subject, entry.who) == ('tare', 'crisps', 'claimed:anna')
    assert entry.new['masses'] == pytest.approx(list(masses / 1000))
    assert entry.new['mean'] == pytest.approx(np.mean(masses) / 1000)
    assert entry.new['accepted'] is False


def test_an_accepted_mean_is_the_only_change_of_the_recipes(recipes: Path):
    before = read_recipes(recipes)
    status, told = control(recipes, 'crisps', GOOD, '--accept')
    assert status == 0, told
    tare = round(float(np.mean(GOOD)) / 1000, 6)
    wanted = before | {'crisps': replace(before['crisps'], tare=tare)}
    assert repr(read_recipes(recipes)) == repr(wanted)
    assert read_log(recipes.with_name('audit.log')).entries[-1].new['accepted'] is True
