# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports, which are valid pages that need no other file, and contain the values of the data."""

import hashlib
import html
from html.parser import HTMLParser
import math
import re
import xml.etree.ElementTree as ET

from made_evaluations import errors_with, make_condition, make_evaluation, make_example
import numpy as np
import pytest

from checkweigher_validation.accuracy.classes import AccuracyClass
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.examples import Example
from checkweigher_validation.accuracy.machine_tables import ATTAINABLE, MachineResult
from checkweigher_validation.report.content import grams, looks_of, number
from checkweigher_validation.report.machines_page import render_machines
from checkweigher_validation.report.page import render
from checkweigher_validation.report.signal_figures import amplitude_spectrum, energy_limit

# Elements that HTML leaves open.
VOID = {'meta', 'link', 'br', 'img', 'hr', 'input'}
SVG = '{http://www.w3.org/2000/svg}'


class Page(HTMLParser):
    """Parser that checks the nesting of the elements of a page, and collects its tables."""

    def __init__(self, text):
        super().__init__()
        self.elements = []
        self.tables = []
        self._open = []
        self._cell = None
        self.feed(text)
        assert not self._open

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)
        if tag == 'table':
            self.tables.append([])
        elif tag == 'tr':
            self.tables[-1].append([])
        elif tag in ('td', 'th'):
            self._cell = []

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self._open.pop() == tag
        if tag in ('td', 'th'):
            self.tables[-1][-1].append(' '.join(''.join(self._cell).split()))
            self._cell = None

    def handle_data(self, data):
        if self._cell is not None:
            self._cell.append(data)


def figures_of(text):
    """Return the figures of a page as XML trees by their descriptions."""
    trees = [ET.fromstring(found) for found in re.findall(r'<svg.*?</svg>', text, re.S)]
    return {tree.get('aria-label'): tree for tree in trees}


@pytest.fixture(scope='module')
def text():
    examples = (make_example(), make_example(speed=0.5))
    return render(make_evaluation(examples=examples), nominal=0.15)


@pytest.fixture(scope='module')
def page(text):
    return Page(text)


@pytest.fixture(scope='module')
def machines():
    names = (ATTAINABLE, 'mean', 'gauss_markov')
    tuned = make_evaluation(estimators=names)
    untrained = make_evaluation(estimators=names, parts=('test',))
    result = MachineResult(9, tuned, untrained, chosen='mean')
    return render_machines([result], 'Machines <9>', (('seed', '9 & 10'),))


def table_with(page, header):
    """Return the table with the cell `header` in one of its first two rows."""
    (found,) = [table for table in page.tables if header in [*table[0], *table[1]]]
    return found


@pytest.mark.parametrize('name', ['text', 'machines'])
def test_a_page_needs_nothing_from_elsewhere(request, name):
    text = request.getfixturevalue(name)
    for tag, attributes in Page(text).elements:
        assert tag not in ('script', 'link', 'iframe', 'object', 'embed', 'base')
        for name, value in attributes.items():
            if name in ('src', 'href', 'xlink:href', 'srcset', 'data', 'poster', 'action'):
                assert value.startswith('#'), (tag, name, value)
    assert '@import' not in text
    assert '{{' not in text
    assert all(target.startswith('#') for target in re.findall(r'url\(\s*["\']?(.)', text))
    # The rest are the names of the namespaces, which no reader fetches.
    addresses = set(re.findall(r'https?://[^"\'<>\s)]+', text))
    assert addresses <= {'http://www.w3.org/2000/svg', 'http://www.w3.org/1999/xlink'}


@pytest.mark.parametrize('name', ['text', 'machines'])
def test_each_printed_sheet_has_title_and_id_of_the_report_and_its_number(request, name):
    page = request.getfixturevalue(name)
    title = html.unescape(re.search('<title>(.*)</title>', page)[1])
    left, report, right = re.findall(r'@bottom-\w+ \{ content: (.*); \}', page)
    said = re.sub(r'\\([0-9a-f]+) ', lambda found: chr(int(found[1], 16)), left)
    assert said == f'"{title}"'
    assert right == '"sheet " counter(page) " of " counter(pages)'
    (report_id,) = re.fullmatch('"report ([0-9a-f]{12})"', report).groups()
    without = page.replace(report_id, 12 * '-')
    assert hashlib.sha256(without.encode()).hexdigest().startswith(report_id)


def test_every_reference_within_the_page_has_one_target(page):
    attributes = [each for _, each in page.elements]
    ids = [each['id'] for each in attributes if 'id' in each]
    targets = {each['xlink:href'][1:] for each in attributes if 'xlink:href' in each}

    assert len(set(ids)) == len(ids)
    assert targets
    assert targets <= set(ids)


def test_names_from_outside_stay_text(text, page, machines):
    assert 'A line &lt;of&gt; tests &amp; more' in text
    assert '1 &amp; 2' in text
    assert ('of', {}) not in page.elements
    assert 'Machines &lt;9&gt;' in machines
    assert '9 &amp; 10' in machines


def test_tables_and_figures_of_machines_are_of_tuned_and_untrained(machines):
    words = re.sub(r'<[^>]*>', ' ', machines)
    assert 'tuned: Window mean with 2.00 on average and 2.00 at worst' in words
    assert len(figures_of(machines)) == 2
    assert 'machine 9, tune chooses Window mean' in words
    assert 'Tune chooses mean on 1.' in words


def test_all_figures_are_sound_xml_with_text_as_text(text):
    figures = figures_of(text)

    # A by mass, averages, pass, ideal, spectrum, bands, denoised.
    assert len(figures) == 7
    for tree in figures.values():
        assert tree.tag == SVG + 'svg'
        assert tree.get('viewBox')
        assert any(element.tag == SVG + 'text' for element in tree.iter())
        assert not any('metadata' in element.tag for element in tree.iter())


def test_every_color_of_a_figure_is_one_that_the_page_defines(text):
    style = text[text.index('<style>') : text.index('</style>')]
    defined = set(re.findall(r'(--[\w-]+):', style))
    for figure in re.findall(r'<svg.*?</svg>', text, re.S):
        used = set(re.findall(r'var\((--[\w-]+)\)', figure))
        assert used <= defined
        # Fully black or white would vanish on one of the two grounds.
        assert not re.findall(r'(?:fill|stroke): #[0-9a-f]{3,6}', figure)


def test_light_and_dark_define_the_same_colors(text):
    style = text[text.index('<style>') : text.index('</style>')]
    light, dark = style.split('prefers-color-scheme: dark')
    names = set(re.findall(r'(--[\w-]+):', light)) - {'--font'}

    assert names == set(re.findall(r'(--[\w-]+):', dark))
    assert {'--series-0', '--series-1'} <= names


def test_the_summary_is_that_of_the_test_passes_the_best_first(page):
    table = table_with(page, 'A of the paper, g')

    # sigma 0.05 g and 0.1 g on average over the speeds; class XIII(1): sigma 0.24 g at least
    # and mu 0.1 g, which both keep everywhere. Training differs in the sign of mu alone.
    assert [' '.join(row) for row in table[1:]] == [
        'Hann mean 0.160 0.050 0.010 2.50 25 of 25 0 0.160 ',
        'ISWD-EKSI 0.320 0.100 0.020 5.00 25 of 25 0 0.320 0.308',
    ]


def test_the_table_by_speed_says_index_and_ratio_the_bound_and_the_paper(page):
    table = next(t for t in page.tables if t[0][:2] == ['estimator', '30 m/min'])

    assert table[0] == ['estimator', *(f'{v} m/min' for v in (30, 45, 60, 75, 90)), 'all']
    # A = 0.01 + 3 * 0.05 v.
    assert table[1][:2] == ['Hann mean', '0.085 ×1.25']
    assert table[1][5:] == ['0.235 ×3.75', '0.160 ×2.50']
    assert table[3] == ['3 × bound of σ', *['0.060'] * 6]
    assert table[4][:2] == ['paper: ISWD-EKSI', '0.124']


def test_all_conditions_stand_beside_table_3_of_the_paper(page):
    test, train = (table for table in page.tables if table[0][0] == 'σ / μ, g')

    assert test[0][1:6] == ['74.5 g', '134.5 g', '164.5 g', '194.5 g', '254.5 g']
    assert test[1] == ['30 m/min']
    assert test[2] == ['bound of σ', *['0.020'] * 5, '', '']
    assert test[3] == ['Hann mean', *['0.025 / 0.010'] * 5, '0.085', '1.25']
    assert test[4] == ['ISWD-EKSI', *['0.050 / 0.020'] * 5, '0.170', '2.50']
    assert test[5][:3] == ['the paper', '0.029 / 0.039', '0.038 / 0.033']
    assert test[5][-2:] == ['0.124', '']
    assert len(test) == 1 + 5 * 5
    # In training the errors are negative.
    assert train[3][1] == '0.025 / −0.010'


def test_the_limits_of_prepackages_are_there_if_asked_for(page, text):
    assert ['6.80 g', '143.20 g', '136.40 g'] in table_with(page, 'TU1')
    assert '<strong>suitable</strong>' in text
    of_one_gram = AccuracyClass('XIII', interval=1e-3)  # errs by 1 g in service, a fifth is 0.9 g
    assert '<strong>NOT suitable</strong>' in render(make_evaluation(), of_one_gram, nominal=0.1)
    assert 'Prepackages' not in render(make_evaluation(speeds=(1.0,)))
    with pytest.raises(ValueError, match='for which the directive has limits'):
        render(make_evaluation(), nominal=20.0)


def test_a_condition_that_fails_says_by_what():
    cases = {'biased': (0.2e-3, 0.1e-3, 60), 'noisy': (0.0, 0.5e-3, 60)}
    cases |= {'both': (0.2e-3, 0.5e-3, 60), 'few': (0.0, 0.1e-3, 30), 'good': (0.0, 0.1e-3, 60)}
    conditions = tuple(
        make_condition(errors_with(mean, std_dev, count), name, faults=60 - count)
        for name, (mean, std_dev, count) in cases.items()
    )
    evaluation = Evaluation('failing', conditions, ())
    text = render(evaluation)
    verdicts = next(t for t in Page(text).tables if t[1][0] == 'g')

    assert [row[1] for row in verdicts[2:]] == ['μ', 'σ', 'μ σ', 'n', '✓']
    assert 'in all conditions: good.' in text
    assert 'Passes that got no mass: few 30.' in text


def test_the_class_is_the_one_that_is_asked_for(page):
    limits = [row[1:] for row in table_with(page, 'largest σ, g')[1:]]
    assert limits[1::3] == [['0.100', '0.3228', '60'], ['0.150', '0.4800', '60']]  # Table 2
    own = AccuracyClass('XIIII', factor=2, interval=1e-3, in_service=True)
    text = render(make_evaluation(speeds=(1.0,)), own)
    table = table_with(Page(text), 'largest σ, g')

    assert 'Accuracy class XIIII(2), e = 1 g, in service' in text
    # 74.5 e: 1 e, twice in service; 0.3 g in service, twice for x = 2. 254.5 e: 1.5 e.
    assert table[1][1:3] == ['2.000', '0.6000']
    assert table[5][1:3] == ['3.000', '1.2000']


def test_coverages_and_faults_are_there_for_each_part(page):
    table = table_with(page, 'weighed')

    # 0.1 g is stated, 0.099446 g and 0.196 g are the ends. The first: |error| is at most
    # 0.01 + 0.05 v 0.99 g, less than 0.0994 at each v, all are in. The second: 0.02 +- 0.0992 v:
    # of 0.0696, -0.0296; 0.0944, -0.0544; 0.119, -0.079; 0.144, -0.104; 0.169, -0.129.
    assert table[2] == ['Hann mean', *('100.0 %', '100.0 %', '1500', '0') * 2]
    assert table[3][1:3] == ['50.0 %', '100.0 %']


def test_an_evaluation_at_other_masses_has_nothing_of_the_paper():
    values = {'speeds': (0.4,), 'masses': (0.1, 0.2), 'parts': ('test',), 'bound': math.nan}
    text = render(make_evaluation(**values))
    tables = Page(text).tables
    assert all('paper' not in cell for table in tables for row in table for cell in row)
    assert 'Long et al.' not in text
    assert len(figures_of(text)) == 2


def test_an_evaluation_without_any_weighing_is_reported_all_the_same():
    conditions = (make_condition([], faults=60), make_condition([], 'other', faults=60))
    text = render(Evaluation('nothing', conditions, ()))

    assert 'No estimator has weighed at least two passes in every condition.' in text
    assert len(figures_of(text)) == 2


def test_a_pass_without_an_ideal_is_shown_without_it():
    evaluation = make_evaluation(speeds=(1.0,), examples=(make_example(with_ideal=False),))
    text = render(evaluation)
    assert text == render(evaluation)  # to the byte

    assert len(figures_of(text)) == 6
    assert not any(
        'the response of the platform without noise: the load' in label
        for label in figures_of(text)
    )


def test_the_amplitude_spectrum_at_zero_is_the_area():
    signal = np.array((0.0, 1.0, 2.0, 1.0, 0.0))
    frequency, amplitude = amplitude_spectrum(signal, 10.0)

    assert frequency[0] == 0
    assert frequency[-1] == 5.0
    assert amplitude[0] == pytest.approx(0.4)


def test_the_energy_limit_of_a_bell_is_that_of_theory():
    # exp(-t^2 / 2 s^2) has the spectral energy exp(-(2 pi f s)^2), a normal distribution over f of
    # deviation 1 / (sqrt(8) pi s): 99 % lie within 2.5758 of it.
    time = (np.arange(384) - 192) / 960
    bell = np.exp(-0.5 * (time / 0.02) ** 2)
    example = Example(1.0, 0.1, 960.0, 0.1, 0.15, 0.25, 0.3, bell, bell)

    # The grid of frequencies has steps of 0.12 Hz.
    assert energy_limit(example) == pytest.approx(
        2.5758 / (math.sqrt(8) * math.pi * 0.02), abs=0.12
    )


@pytest.mark.parametrize(
    ('value', 'shown'),
    [(1.2345, '1.234'), (-0.5, '−0.500'), (-0.0001, '0.000'), (math.nan, '–'), (math.inf, '–')],
)
def test_numbers_are_shown_with_a_true_minus_and_no_minus_zero(value, shown):
    assert number(value) == shown
    assert grams(value / 1000) == shown


def test_each_estimator_has_a_look_of_its_own():
    names = ('mean', 'hann', 'tvlpf', 'aid', 'aeksi', 'iswd_eksi', 'fir_model', 'gauss_markov')
    looks = looks_of((*names, 'mine', 'yours'))

    assert looks['mine'].label == 'mine'
    for attribute in ('label', 'marker', 'light', 'dark'):
        assert len({getattr(look, attribute) for look in looks.values()}) == len(looks)
    # They do not depend on who else is there.
    assert looks_of(('aid',))['aid'] == looks['aid']
