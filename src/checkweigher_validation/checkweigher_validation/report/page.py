# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The report as one HTML page, with tables from `content` and inline figures."""

from collections.abc import Iterator, Sequence
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from matplotlib import rc_context
from matplotlib.figure import Figure

from checkweigher_production import prepackages
from checkweigher_validation.accuracy.classes import AccuracyClass, suitability, weighings_required
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.examples import Example
from checkweigher_validation.accuracy.tables import LEVELS
from checkweigher_validation.report import accuracy_figures, content, signal_figures
from checkweigher_validation.report.inline_svg import STYLE, to_inline_svg
from checkweigher_validation.report.palette import looks_of


@rc_context(STYLE)
def render(
    evaluation: Evaluation,
    accuracy_class: AccuracyClass = AccuracyClass(),
    nominal: float | None = None,
) -> str:
    """Return the report of an evaluation as one HTML page that needs no other file.

    Parameters
    ----------
    evaluation : Evaluation
        At least one condition. The report is of part 'test' if there is one.
    accuracy_class : AccuracyClass
        Class whose limits are applied to the conditions.
    nominal : float, optional
        Nominal quantity of prepackages in kg. Their limits are shown, and whether a scale of the
        class may check them.

    Raises
    ------
    ValueError
        If the prepackages have no limits.
    """
    shown = content.Content(evaluation, accuracy_class)
    return fill(
        'report.html.j2',
        evaluation.estimators,
        evaluation=evaluation,
        content=shown,
        part=shown.part,
        accuracy_class=accuracy_class,
        prepackage=None if nominal is None else prepackages.limits(nominal),
        suitable=None if nominal is None else suitability(accuracy_class, nominal),
        accuracy_pictures=_accuracy_pictures(evaluation, shown.part),
        signal_pictures=list(_signal_pictures(evaluation.examples)),
        weighings_required=weighings_required,
    )


def fill(template: str, estimators: Sequence[str] = (), **values: Any) -> str:
    """Return the page of a template with values, and with the colours of estimators."""
    environment = Environment(
        loader=PackageLoader('checkweigher_validation.report', ''),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    shared = {
        'grams': content.grams,
        'levels': [f'{100 * level:.0f} %' for level in LEVELS],
        'looks': list(looks_of(tuple(estimators)).values()),
        'mass_label': content.mass_label,
        'number': content.number,
        'speed_label': content.speed_label,
    }
    return environment.get_template(template).render(shared | values)


def picture(name: str, figure: Figure, caption: str) -> Markup:
    """Return a figure with its caption; `name` begins its ids, which are unique on a page."""
    svg = Markup(to_inline_svg(figure, name, caption))
    return Markup(
        '<figure>\n<div class="scroll">{}</div>\n<figcaption>{}</figcaption>\n</figure>'
    ).format(svg, caption)


def _accuracy_pictures(evaluation: Evaluation, part: str) -> Iterator[Markup]:
    yield picture(
        'index-by-mass',
        accuracy_figures.index_by_mass_figure(evaluation, part),
        'A of each estimator over the mass, one panel for each belt speed; lower is better. An '
        'unbiased linear estimate gets below the dashed line, three times the Gauss-Markov bound, '
        'by chance only. (As figure 11 of the paper; logarithmic, each panel on a scale of its '
        'own.)',
    )
    yield picture(
        'averages',
        accuracy_figures.averages_figure(evaluation, part),
        'Left: A on average over the masses, by belt speed; the distance to the dashed line is '
        'what an estimator leaves to be gained. Right: A on average over everything, the best on '
        'top. (As figure 12.)',
    )


def _signal_pictures(examples: tuple[Example, ...]) -> Iterator[Markup]:
    if not examples:
        return
    slow = min(examples, key=lambda one: (one.speed, -one.mass))
    fast = max(examples, key=lambda one: (one.speed, one.mass))
    of_slow, of_fast = (
        f'{content.mass_label(one.mass)} at {content.speed_label(one.speed)}'
        for one in (slow, fast)
    )
    yield picture(
        'pass',
        signal_figures.pass_figure(slow),
        f'A pass, {of_slow}. From t1 to t2 the product rides on, from t3 to t4 it leaves; all '
        'there is to weigh it lies in the shaded window. (As figure 2 of the paper.)',
    )
    if len(fast.ideal):
        yield picture(
            'ideal',
            signal_figures.ideal_figure(fast),
            f'A pass, {of_fast}, and what the platform would show without any noise: the load '
            'and the ringing from its entry. Below, the difference of the two. (As figure 5.)',
        )
    yield picture(
        'spectrum',
        signal_figures.spectrum_figure(fast),
        f'The spectrum of a pass, {of_fast}. The load lies at the lowest frequencies, the '
        'ringing about the natural frequency of the platform; where the signal stands above the '
        'line without noise, it is disturbed. (As figure 6.)',
    )
    if fast.bands:
        yield picture(
            'bands',
            signal_figures.bands_figure(fast),
            'The same pass in the bands of the stationary wavelet transform, each on a scale of '
            'its own. The lower the band, the longer its wavelet, and the more of what surrounds '
            'the shaded window gets into it. (As figure 7.)',
        )
    if fast.denoised:
        yield picture(
            'denoised',
            signal_figures.denoised_figure(fast),
            'The window after hard and soft thresholding of all details and after shrinkage, '
            'against the response without noise and the mass that is to be found. (As figures 8 '
            'and 9.)',
        )
