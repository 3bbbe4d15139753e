"""What the tables of the report say: numbers as they are shown, and which of them are the best."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math

from checkweigher_validation.accuracy.classes import (
    AccuracyClass,
    Judgement,
    judge,
    max_mean_error,
    max_std_dev,
    weighings_required,
)
from checkweigher_validation.accuracy.errors import Average, Evaluation, average, coverage
from checkweigher_validation.accuracy.paper_table import paper_index, paper_result
from checkweigher_validation.accuracy.tables import (
    GRAMS,
    LEVELS,
    METRES_PER_MINUTE,
    has_paper_masses,
    has_paper_speeds,
)
from checkweigher_validation.report.palette import looks_of

NONE = '–'


@dataclass(frozen=True, slots=True)
class Cell:
    """What stands in a cell of a table.

    Attributes
    ----------
    text : str
        Empty if there is nothing to say.
    note : str
        Smaller, after it.
    best : bool
        Whether no other row has a better one.
    state : str
        'passed', 'failed' or empty.
    """

    text: str
    note: str = ''
    best: bool = False
    state: str = ''


@dataclass(frozen=True, slots=True)
class Row:
    """One row: who, in which colour (its number, -1 for none), and the cells."""

    label: str
    series: int
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class SpeedGroup:
    """The rows of one belt speed."""

    label: str
    rows: tuple[Row, ...]


def number(value: float, digits: int = 3) -> str:
    """Return a number as it is shown, with a true minus; a dash if it is not known."""
    if not math.isfinite(value):
        return NONE
    # Adding zero makes a plain one of what rounds to minus zero.
    return f'{round(value, digits) + 0.0:.{digits}f}'.replace('-', '−')


def grams(value: float, digits: int = 3) -> str:
    """Return kg as grams."""
    return number(GRAMS * value, digits)


def speed_label(speed: float) -> str:
    """Return m/s as m/min."""
    return f'{METRES_PER_MINUTE * speed:.4g} m/min'


def mass_label(mass: float) -> str:
    """Return kg as grams, in full."""
    return f'{GRAMS * mass:.6g} g'


def summary(evaluation: Evaluation, accuracy_class: AccuracyClass) -> list[Row]:
    """Return one row for each estimator, the smallest A first, and the bound."""
    part = evaluation.parts[0]
    comparable = has_paper_masses(evaluation) and has_paper_speeds(evaluation)
    looks = looks_of(evaluation.estimators)
    means = {name: average(evaluation.select(estimator=name, part=part)) for name in looks}
    best = _best(one.index for one in means.values())
    rows = []
    for name in sorted(looks, key=lambda one: _rank(means[one].index)):
        there = evaluation.select(estimator=name, part=part)
        passed = sum(judge(one, accuracy_class).passed for one in there)
        trained = average(evaluation.select(estimator=name, part='train')).index
        one = means[name]
        state = 'passed' if passed == len(there) else 'failed'
        cells = [
            Cell(grams(one.index), best=one.index == best),
            Cell(grams(one.std_dev)),
            Cell(grams(one.mean_error)),
            Cell(number(one.ratio, 2)),
            Cell(f'{passed} of {len(there)}', state=state),
            Cell(str(one.faults), state='failed' if one.faults else ''),
        ]
        if 'train' in evaluation.parts and part != 'train':
            cells.append(Cell(grams(trained)))
        if comparable:
            cells.append(Cell(_or_empty(grams(paper_index(name)))))
        rows.append(Row(looks[name].label, _series(evaluation, name), tuple(cells)))
    return rows


def findings(evaluation: Evaluation, accuracy_class: AccuracyClass) -> list[str]:
    """Return the sentences that the report begins with."""
    part = evaluation.parts[0]
    looks = looks_of(evaluation.estimators)
    means = {name: average(evaluation.select(estimator=name, part=part)) for name in looks}
    order = sorted(looks, key=lambda name: _rank(means[name].index))
    sentences = [_finding_of(looks[order[0]].label, means[order[0]])]
    meeting = [
        looks[name].label
        for name in looks
        if all(
            judge(one, accuracy_class).passed
            for one in evaluation.select(estimator=name, part=part)
        )
    ]
    who = _enumerate(meeting) if meeting else 'no estimator'
    sentences.append(f'Within the limits of {accuracy_class} in all conditions: {who}.')
    faulty = [f'{looks[name].label} {means[name].faults}' for name in looks if means[name].faults]
    if faulty:
        sentences.append(f'Passes that got no mass: {_enumerate(faulty)}.')
    return sentences


def by_speed(evaluation: Evaluation, part: str) -> list[Row]:
    """Return A, and sigma over its bound, of each estimator at each speed, mean of the masses."""
    looks = looks_of(evaluation.estimators)
    columns = []
    for speed in (*evaluation.speeds, None):
        means = {
            name: average(evaluation.select(estimator=name, speed=speed, part=part))
            for name in looks
        }
        best = _best(one.index for one in means.values())
        columns.append(
            {
                name: Cell(grams(one.index), _times(one.ratio), one.index == best)
                for name, one in means.items()
            }
        )
    rows = [
        Row(look.label, _series(evaluation, name), tuple(column[name] for column in columns))
        for name, look in looks.items()
    ]
    return [*rows, _bound_by_speed(evaluation, part), *_paper_by_speed(evaluation)]


def table_3(evaluation: Evaluation, part: str) -> list[SpeedGroup]:
    """Return sigma and mu of each condition by speed, the paper's below ours."""
    groups = []
    for speed in evaluation.speeds:
        rows = [_bound_row(evaluation, speed, part)]
        for name in evaluation.estimators:
            if evaluation.select(estimator=name, speed=speed, part=part):
                rows.append(_condition_row(evaluation, name, speed, part))
                rows += _paper_row(evaluation, name, speed)
        groups.append(SpeedGroup(speed_label(speed), tuple(rows)))
    return groups


def has_paper(evaluation: Evaluation) -> bool:
    """Whether the paper has anything at these speeds and masses."""
    return any(
        paper_result(one.estimator, one.speed, one.mass) is not None
        for one in evaluation.conditions
    )


def class_limits(evaluation: Evaluation, accuracy_class: AccuracyClass) -> list[Row]:
    """Return the limits at each mass."""
    rows = []
    for mass in evaluation.masses:
        mean_error = max_mean_error(
            mass, accuracy_class.interval, accuracy_class.name, accuracy_class.in_service
        )
        std_dev = max_std_dev(mass, accuracy_class.factor, accuracy_class.in_service)
        cells = (
            Cell(grams(mean_error)),
            Cell(grams(std_dev, 4)),
            Cell(str(weighings_required(mass))),
        )
        rows.append(Row(mass_label(mass), -1, cells))
    return rows


def verdicts(evaluation: Evaluation, accuracy_class: AccuracyClass, part: str) -> list[Row]:
    """Return one row for each estimator, with one cell for each speed and mass."""
    looks = looks_of(evaluation.estimators)
    rows = []
    for name, look in looks.items():
        cells = []
        for speed in evaluation.speeds:
            for mass in evaluation.masses:
                there = evaluation.select(estimator=name, speed=speed, mass=mass, part=part)
                cells.append(_verdict(judge(there[0], accuracy_class)) if there else Cell(''))
        rows.append(Row(look.label, _series(evaluation, name), tuple(cells)))
    return rows


def coverages(evaluation: Evaluation) -> list[Row]:
    """Return how often the stated intervals hold the error: for each part, for each level."""
    looks = looks_of(evaluation.estimators)
    rows = []
    for name, look in looks.items():
        cells = []
        for part in evaluation.parts:
            there = evaluation.select(estimator=name, part=part)
            cells += [Cell(_percent(coverage(there, level))) for level in LEVELS]
            means = average(there)
            cells += [Cell(str(means.count)), Cell(str(means.faults))]
        rows.append(Row(look.label, _series(evaluation, name), tuple(cells)))
    return rows


def _condition_row(evaluation: Evaluation, name: str, speed: float, part: str) -> Row:
    cells = []
    there = evaluation.select(estimator=name, speed=speed, part=part)
    for mass in evaluation.masses:
        found = evaluation.select(estimator=name, speed=speed, mass=mass, part=part)
        cells.append(_pair(found[0].std_dev, found[0].mean_error) if found else Cell(''))
    means = average(there)
    cells += [Cell(grams(means.index)), Cell(number(means.ratio, 2))]
    look = looks_of(evaluation.estimators)[name]
    return Row(look.label, _series(evaluation, name), tuple(cells))


def _paper_row(evaluation: Evaluation, name: str, speed: float) -> Iterable[Row]:
    """Yield what the paper has for an estimator at a speed, if it has anything."""
    found = [paper_result(name, speed, mass) for mass in evaluation.masses]
    if any(found):
        cells = [_pair(one.std_dev, one.mean_error) if one else Cell('') for one in found]
        whole = has_paper_masses(evaluation)
        cells += [Cell(grams(paper_index(name, speed)) if whole else ''), Cell('')]
        yield Row('the paper', -1, tuple(cells))


def _bound_row(evaluation: Evaluation, speed: float, part: str) -> Row:
    cells = []
    for mass in evaluation.masses:
        there = evaluation.select(speed=speed, mass=mass, part=part)
        cells.append(Cell(grams(there[0].bound) if there else ''))
    return Row('bound of σ', -1, (*cells, Cell(''), Cell('')))


def _bound_by_speed(evaluation: Evaluation, part: str) -> Row:
    bounds = (
        average(evaluation.select(speed=speed, part=part)).bound
        for speed in (*evaluation.speeds, None)
    )
    return Row('3 × bound of σ', -1, tuple(Cell(grams(3 * one)) for one in bounds))


def _paper_by_speed(evaluation: Evaluation) -> Iterable[Row]:
    if not has_paper_masses(evaluation):
        return
    for name, look in looks_of(evaluation.estimators).items():
        cells = [Cell(_or_empty(grams(paper_index(name, speed)))) for speed in evaluation.speeds]
        if any(cell.text for cell in cells):
            whole = has_paper_speeds(evaluation)
            cells.append(Cell(grams(paper_index(name)) if whole else ''))
            yield Row(f'paper: {look.label}', -1, tuple(cells))


def _verdict(judgement: Judgement) -> Cell:
    if judgement.passed:
        return Cell('✓', state='passed')
    reasons = [
        *([] if judgement.mean_error_passed else ['μ']),
        *([] if judgement.std_dev_passed else ['σ']),
        *([] if judgement.enough_weighings else ['n']),
    ]
    return Cell(' '.join(reasons), state='failed')


def _finding_of(label: str, means: Average) -> str:
    if math.isnan(means.index):
        return 'No estimator has weighed at least two passes in every condition.'
    times = f'; its σ is {number(means.ratio, 2)} times the bound' if means.ratio > 0 else ''
    return f'Smallest A on average: {label} with {grams(means.index)} g{times}.'


def _series(evaluation: Evaluation, name: str) -> int:
    return evaluation.estimators.index(name)


def _pair(std_dev: float, mean_error: float) -> Cell:
    return Cell(f'{grams(std_dev)} / {grams(mean_error)}')


def _times(ratio: float) -> str:
    return '' if math.isnan(ratio) else f'×{number(ratio, 2)}'


def _percent(share: float) -> str:
    return NONE if math.isnan(share) else f'{number(100 * share, 1)} %'


def _or_empty(text: str) -> str:
    return '' if text == NONE else text


def _rank(value: float) -> float:
    return math.inf if math.isnan(value) else value


def _best(values: Iterable[float]) -> float:
    return min((value for value in values if not math.isnan(value)), default=math.nan)


def _enumerate(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f'{", ".join(names[:-1])} and {names[-1]}'
