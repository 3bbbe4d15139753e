# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Findings of nodes in the language of a viewer, and the table against the code of the nodes."""

import ast
from collections.abc import Iterator
import re

import pytest
from running import ROOT

from checkweigher_core.health.disk import DiskWatch
from checkweigher_core.health.host_clock import tracking_finding
from checkweigher_core.records import StopRequest
from checkweigher_core.records.reasons import StopReason
from checkweigher_dsp.health.items import RejectorWatch
from checkweigher_validation.verification.plan import Mass as ReferenceMass
from checkweigher_validation.verification.steps import Step, StepKind
from checkweigher_web.languages.findings import HINTS, REASONS, TEXTS
from checkweigher_web.languages.language import Text, language
from checkweigher_web.languages.wording import from_node

# Packages of the nodes whose diagnostics the page shows.
PACKAGES = ('core', 'driver', 'dsp', 'production')
# Places of text and hint, a slice, among the arguments of the calls that make findings.
MAKERS = {'warn_if': (1, 3), 'error_if': (1, 3), 'Concern': (1, 3), 'Finding': (2, 4)}
# Expressions for texts and hints that the code makes elsewhere. The table has those of them that
# can be translated, and docs/page.md names the others.
MADE_ELSEWHERE = {
    'Reason(reason).hint',
    'Reason.FOREIGN_PUBLISHER.hint',
    '_HINTS.get(name, _STAGE_HINT)',
    'altered',
    'hint',
    'missed',
    'port',
    'product.unresolved(production.std_dev)',
    'reason.hint',
    'self.broken',
    'self.doubt',
    'self.found',
    'self.trouble',
    'text',
    'trouble',
}
WELL = 'running'  # text of a node with the level OK, which the page does not show
# Values of placeholders, by the last word of their names. Others have the value 'x'.
EXAMPLES = {
    'mass': '1.5 g',
    'count': '3',
    'word': 'a',
    'topic': '/a',
    'hint': REASONS[0],
    'advice': REASONS[0],
}


def shape(template: str) -> str:
    """Return a text with its placeholders, each with the unit of a mass, replaced by {}."""
    return re.sub(r'{\w*}( k?g\b)?', '{}', template)


SHAPES = [{shape(each.template) for each in table} for table in (TEXTS, HINTS)]


def assigned(name: str, scope: ast.FunctionDef | ast.Module) -> list[ast.expr]:
    """Return the values that a function or the top of a module assigns to a variable."""
    nodes = scope.body if isinstance(scope, ast.Module) else ast.walk(scope)
    return [
        each.value
        for each in nodes
        if isinstance(each, ast.Assign)
        and any(isinstance(to, ast.Name) and to.id == name for to in each.targets)
    ]


def texts_of(
    value: ast.expr, function: ast.FunctionDef, module: ast.Module
) -> Iterator[tuple[str, bool]]:
    """Yield each text that an expression in a function may have, with {} for its placeholders.

    The second value is True. It is False for an expression that is no text or variable with texts.
    """
    match value:
        case ast.Constant(value=str(text)):
            yield text, True
        case ast.JoinedStr(values=parts):
            literals = [str(e.value) if isinstance(e, ast.Constant) else '{}' for e in parts]
            yield ''.join(literals), True
        case ast.IfExp(body=one, orelse=other):
            yield from texts_of(one, function, module)
            yield from texts_of(other, function, module)
        case ast.Name(id=name) if found := assigned(name, function) or assigned(name, module):
            for each in found:
                yield from texts_of(each, function, module)
        case _:
            yield ast.unparse(value), False


def findings_in(module: ast.Module) -> Iterator[tuple[int, str, bool]]:
    """Yield the texts (0) and hints (1) of the findings of a module, as `texts_of` does."""
    functions = [each for each in ast.walk(module) if isinstance(each, ast.FunctionDef)]
    for function in functions:
        for call in ast.walk(function):
            if not isinstance(call, ast.Call) or 'Level.OK' in map(ast.unparse, call.args):
                continue
            first, last = MAKERS.get(ast.unparse(call.func), (0, 0))
            for kind, value in enumerate(call.args[first:last]):
                for text, is_text in texts_of(value, function, module):
                    yield kind, text, is_text


def made() -> set[tuple[int, str, bool]]:
    """Return the texts (0) and hints (1) of the findings of all nodes, as `texts_of` does."""
    folders = [ROOT / f'src/checkweigher_{each}/checkweigher_{each}' for each in PACKAGES]
    paths = [path for folder in folders for path in folder.rglob('*.py')]
    others = [path for path in paths if path.name != 'findings.py']  # which defines the calls
    return {each for path in others for each in findings_in(ast.parse(path.read_text()))}


def test_the_page_knows_each_text_and_each_hint():
    found = made()
    unknown = {
        text
        for kind, text, is_text in found
        if is_text and re.search(r'[a-z]', text) and shape(text) not in SHAPES[kind]
    }
    assert unknown == {WELL}, 'add these to languages/findings.py'
    assert {text for _, text, is_text in found if not is_text} == MADE_ELSEWHERE


@pytest.mark.parametrize('table', [TEXTS, HINTS], ids=['texts', 'hints'])
def test_each_pattern_is_recognised(table: tuple[Text, ...]):
    def example(found: re.Match[str]) -> str:
        return EXAMPLES.get(found[1].rpartition('_')[2], 'x')

    for text in table:
        known = from_node(re.sub(r'{(\w+)}', example, text.template))
        assert isinstance(known, Text)
        assert known.template == text.template


def test_text_and_hint_of_a_finding_are_translated():
    german, chinese = language('de'), language('zh_CN')
    request = StopRequest(StopReason.GUARD_OPEN, 5, text='input guard')
    stopped = RejectorWatch().finding(0.0, request, confirmed=True).message
    assert german(from_node(stopped)) == (
        'Stopp angefordert: GuardOpen bei Artikel 5; eine Schutztür der Maschine ist offen; '
        'schließen: Eingang guard; dann den Stopp zurücksetzen'
    )
    full = DiskWatch(lambda: 50e6).finding(0.0).message
    assert german(from_node(full)).startswith('fast voll: 0,1 GB sind frei; aufgezeichnete Artikel')
    unanswered = tracking_finding('').message
    assert chinese(from_node(unanswered)).startswith('chrony 没有响应；检查 chronyd')


def test_the_hint_of_an_unknown_text_is_translated():
    text = from_node('/a.jsonl: disk quota exceeded; the batch cannot be released')
    assert language('de')(text) == (
        '/a.jsonl: disk quota exceeded; die Charge kann nicht freigegeben werden'
    )


def test_masses_in_a_message_are_in_the_unit_of_the_viewer():
    german = language('de', 'kg')
    changed = 'the zero has fallen by 1.3 g at once'
    hint = 'look whether something was taken off; if not, the load cell has shifted: set the zero'
    zero = from_node(f'{changed}; {hint}')
    assert german(zero).startswith('die Null ist auf einmal um 0,0013 kg gefallen; nach')
    load = ReferenceMass('small', 74.5, 0.01, 'c', 's')
    step = from_node(Step('static_up_small', StepKind.STATIC, load).to_do)
    assert german(step).endswith('legen Sie small (0,0745 kg) auf seine Mitte')
    limits = 'the limits on the line, 90.5 g and none, are not those of the recipe, 90 g and none'
    assert '0,0905 kg und keine,' in german(from_node(limits))
