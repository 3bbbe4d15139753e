# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page of machines: sound, of one piece, with the figures of the tables."""

from html.parser import HTMLParser
import re
import xml.etree.ElementTree as ET

import pytest

from checkweigher_validation.accuracy.machine_tables import ATTAINABLE, MachineResult
from checkweigher_validation.report.machines_page import render_machines


@pytest.fixture(scope='module', name='page')
def _page(make_evaluation):
    names = (ATTAINABLE, 'mean', 'gauss_markov')
    machine = MachineResult(
        9, make_evaluation(estimators=names), make_evaluation(estimators=names, parts=('test',)),
        chosen='mean',
    )  # fmt: skip
    return render_machines([machine], 'Machines <9>', (('seed', '9 & 10'),))


def test_elements_are_closed_as_they_were_opened(page):
    opened = []

    class Elements(HTMLParser):
        def handle_starttag(self, tag, attrs):
            if tag != 'meta':
                opened.append(tag)

        def handle_endtag(self, tag):
            assert opened.pop() == tag

    Elements().feed(page)
    assert not opened


def test_nothing_comes_from_elsewhere(page):
    assert not re.search(r'(src|href)="(?!#)', page)
    assert '{{' not in page


def test_text_is_escaped(page):
    assert 'Machines &lt;9&gt;' in page
    assert '9 &amp; 10' in page


def test_tables_and_figures_tell_of_both(page):
    words = re.sub(r'<[^>]*>', ' ', page)
    assert 'tuned: Window mean with 2.00 on average and 2.00 at worst' in words
    assert len(re.findall('<svg', page)) == 2
    assert all(
        ET.fromstring(found) is not None for found in re.findall(r'<svg.*?</svg>', page, re.S)
    )
    assert 'machine 9, tune chooses Window mean' in words
    assert 'Tune chooses mean on 1.' in words
