# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Functions that check the options of several commands, and that read parameters from files."""

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import math
import os
from pathlib import Path
import re

from checkweigher_bringup.errors import UserError, warn
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.recipes import Product, read_recipes
from checkweigher_recording.archive.copying import is_url
from checkweigher_recording.scratch import remove_abandoned
from checkweigher_validation.cluster import LOCAL, on_scheduler


def line_parameters(
    path: Path | None, estimator: str | None = None, lane: str | None = None
) -> LineParameters:
    """Return the parameters of a file, or the defaults if `path` is None.

    `estimator` replaces the estimator of the file. `lane` is the namespace of the lane to read if
    the file contains the parameters of several lanes.

    Raises `ParameterError` if the file cannot be read, or a value is not valid.
    """
    parameters = LineParameters() if path is None else LineParameters.from_file(path, lane)
    return parameters if estimator is None else parameters.with_estimator(estimator)


def recipe_of(arguments: Namespace) -> Product | None:
    """Return the product of the options `--recipes` and `--product`, or None if both are missing.

    Raises `UserError` if only one of the options is given or the file lacks the product, and
    `SettingsError` if the file cannot be used.
    """
    path, name = arguments.recipes, arguments.product
    if path is None and name is None:
        return None
    if path is None or name is None:
        raise UserError('--recipes and --product must be given together')
    products = read_recipes(path)
    if name not in products:
        raise UserError(f'--product {name}: is not in {path}, which has {", ".join(products)}')
    return products[name]


def estimator_names(
    given: Sequence[str] | None, default: Sequence[str], known: Iterable[str] = ESTIMATORS
) -> list[str]:
    """Return the estimators that an option names, or `default`, without repetitions.

    The name `all` stands for the estimators of `default`, followed by all other names in `known`.
    Raises `UserError` if a name is unknown.
    """
    names: list[str] = []
    for name in given or default:
        if name not in (*known, 'all'):
            raise UserError(
                f'--estimator {name}: is not an estimator; there are {", ".join(sorted(known))}'
            )
        names += (*default, *known) if name == 'all' else (name,)
    return list(dict.fromkeys(names))


def check_namespace(name: str) -> str:
    """Return a ROS namespace without outer slashes, or raise `UserError` if it is not valid."""
    name = name.strip('/')
    if name and not re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', name):
        raise UserError(
            f'--namespace {name}: names are letters, digits and _, and do not begin with a digit'
        )
    return name


def places_of(arguments: Namespace, bags: Iterable[str]) -> list[str]:
    """Return the paths or URLs under which the workers can read the bags.

    For a cluster, a path becomes absolute, because the workers may run in another folder. URLs, and
    all bags for the local scheduler, are returned unchanged.
    """
    is_local = arguments.scheduler == LOCAL
    return [bag if is_local or is_url(bag) else os.path.abspath(bag) for bag in bags]


@contextmanager
def on_scheduler_of(arguments: Namespace) -> Iterator[int | None]:
    """Use the scheduler of the option `--scheduler`, and yield the argument `n_jobs` of `run_jobs`.

    The scheduler is used until the context ends.

    Workers of the cluster that run another version of the program are not used, and are reported on
    stderr. Raises `UserError` if the options cannot be used together, and `SchedulerError` if the
    cluster cannot be used.
    """
    check_positive(arguments, 'jobs')
    if arguments.scheduler != LOCAL and arguments.jobs is not None:
        raise UserError('--jobs: a cluster has one job per worker, so leave out this option')
    if arguments.scheduler != LOCAL and '://' not in arguments.scheduler:
        raise UserError(
            f'--scheduler {arguments.scheduler}: must be local, or an address such as '
            'tcp://HOST:8786'
        )
    with on_scheduler(arguments.scheduler) as refused:
        for line in refused:
            warn(line)
        try:
            yield arguments.jobs
        finally:
            # Interrupted processes may have left temporary folders, which are removed here.
            remove_abandoned()


def refuse(arguments: Namespace, why: str, *names: str) -> None:
    """Raise `UserError` with the reason `why` if one of the options is given."""
    for name in names:
        if getattr(arguments, name) is not None:
            raise UserError(f'--{name}: {why}')


def check_positive(arguments: Namespace, *names: str) -> None:
    """Raise `UserError` if an option was given with a number that is not finite and above 0."""
    for name in names:
        given = getattr(arguments, name)
        for value in given if isinstance(given, list) else [given]:
            if value is not None and not 0 < value < math.inf:
                raise UserError(f'--{name.replace("_", "-")} {value}: must be above 0 and finite')
