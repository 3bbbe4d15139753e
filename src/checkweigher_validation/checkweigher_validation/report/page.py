# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of an evaluation as one HTML page with inline figures."""

from collections.abc import Sequence
import hashlib
from re import sub
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib import rc_context

from checkweigher_production import prepackages
from checkweigher_validation.accuracy.classes import AccuracyClass, suitability, weighings_required
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.tables import LEVELS
from checkweigher_validation.report import accuracy_figures, content, signal_figures
from checkweigher_validation.report.inline_svg import STYLE, to_inline_svg

_NO_ID = 12 * '-'  # placeholder of the report id while the digest of the page is computed


@rc_context(fname=STYLE)
def render(
    evaluation: Evaluation,
    accuracy_class: AccuracyClass = AccuracyClass(),
    nominal: float | None = None,
) -> str:
    """Return the report of an evaluation as one HTML page that needs no other file.

    The report covers the test passes or, if there are none, the training passes. The evaluation
    must have at least one condition. `nominal` is a nominal quantity of prepackages in kg, or None.
    The report shows the limits of this quantity, and whether a scale of the class may check the
    prepackages.

    Raises `ValueError` if 76/211/EEC has no limits for `nominal`.
    """
    shown = content.Content(evaluation, accuracy_class)
    return fill(
        'report.html.j2',
        evaluation.title,
        evaluation.estimators,
        evaluation=evaluation,
        content=shown,
        part=shown.part,
        accuracy_class=accuracy_class,
        prepackage=None if nominal is None else prepackages.limits(nominal),
        suitable=None if nominal is None else suitability(accuracy_class, nominal),
        weighings_required=weighings_required,
        accuracy_figures=accuracy_figures,
        signal_figures=signal_figures,
        slow=min(evaluation.examples, key=lambda one: (one.speed, -one.mass), default=None),
        fast=max(evaluation.examples, key=lambda one: (one.speed, one.mass), default=None),
    )


def fill(template: str, title: str, estimators: Sequence[str] = (), **values: Any) -> str:
    """Return the page from a template with `values` and the plot styles of `estimators`.

    Each printed sheet shows the title and the report id, which is a digest of the page. Equal
    reports therefore have equal ids.
    """
    environment = Environment(
        loader=PackageLoader('checkweigher_validation.report', ''),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters['css_string'] = _css_string
    shared = {
        'title': title,
        'report_id': _NO_ID,
        'grams': content.grams,
        'levels': [f'{100 * level:.0f} %' for level in LEVELS],
        'looks': list(content.looks_of(tuple(estimators)).values()),
        'mass_label': content.mass_label,
        'number': content.number,
        'speed_label': content.speed_label,
        'svg': to_inline_svg,
    }
    page = environment.get_template(template).render(shared | values)
    report_id = hashlib.sha256(page.encode()).hexdigest()[: len(_NO_ID)]
    return page.replace(_NO_ID, report_id)


def _css_string(text: str) -> Markup:
    """Return a text as the content of a CSS string in an HTML page."""
    return Markup(sub(r'[^\w .,:-]', lambda found: f'\\{ord(found[0]):x} ', text))
