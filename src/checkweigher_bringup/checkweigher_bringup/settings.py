# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Options that several commands check, and the parameters of the line that they name."""

from argparse import Namespace
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
import math
import os
from pathlib import Path
import re
import sys

from checkweigher_bringup.errors import UserError
from checkweigher_core.printable import one_line
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.recipes import Product, read_recipes
from checkweigher_recording.archive.copying import is_url
from checkweigher_recording.scratch import remove_abandoned
from checkweigher_validation.archive.program import other_program, program
from checkweigher_validation.cluster import LOCAL, on_scheduler


def line_parameters(
    path: Path | None, estimator: str | None, lane: str | None = None
) -> LineParameters:
    """Return the parameters of a file, or the defaults, with the estimator of the command line.

    `lane` is the namespace that is meant, where the file is for several.
    """
    parameters = LineParameters() if path is None else LineParameters.from_file(path, lane)
    return parameters if estimator is None else parameters.with_estimator(estimator)


def recipe_of(arguments: Namespace) -> Product | None:
    """Return the product that `--recipes` and `--product` name, None without them.

    Raises
    ------
    UserError
        If only one is given, or the file has no such product.
    SettingsError
        If the file cannot be used.
    """
    path, name = arguments.recipes, arguments.product
    if path is None and name is None:
        return None
    if path is None or name is None:
        raise UserError('--recipes and --product belong together: the file, and a product of it')
    products = read_recipes(path)
    if name not in products:
        raise UserError(f'--product {name}: {path} has {", ".join(products)}')
    return products[name]


def estimator_names(given: Sequence[str] | None, default: Sequence[str]) -> list[str]:
    """Return the estimators that an option names, each once, or raise UserError.

    The word all stands for those of `default`, then the others.
    """
    names: list[str] = []
    for name in given or default:
        if name not in (*ESTIMATORS, 'all'):
            known = ', '.join(sorted(ESTIMATORS))
            raise UserError(f'--estimator {name}: no such estimator; there are {known}')
        names += (*default, *ESTIMATORS) if name == 'all' else (name,)
    return list(dict.fromkeys(names))


def check_namespace(name: str) -> str:
    """Return a ROS namespace without its leading slash, or raise UserError."""
    name = name.strip('/')
    if name and not re.fullmatch(r'[A-Za-z_]\w*(/[A-Za-z_]\w*)*', name):
        rule = 'names are letters, digits and _, and do not begin with a digit'
        raise UserError(f'--namespace {name}: {rule}')
    return name


def places_of(arguments: Namespace, bags: Iterable[str]) -> list[str]:
    """Return bags as the workers of `--scheduler` find them, which may run in another folder."""
    if arguments.scheduler == LOCAL:
        return list(bags)
    return [bag if is_url(bag) else os.path.abspath(bag) for bag in bags]


@contextmanager
def on_scheduler_of(arguments: Namespace) -> Iterator[int | None]:
    """Choose where jobs run by `--scheduler`; yield the `n_jobs` of `run_jobs`.

    Workers that are not used are named on stderr.

    Raises
    ------
    UserError
        If the options cannot be used together.
    SchedulerError
        If the cluster cannot be used.
    """
    check_positive(arguments, 'jobs')
    if arguments.scheduler != LOCAL and arguments.jobs is not None:
        raise UserError('--jobs: a cluster has as many as its workers; leave it out')
    if arguments.scheduler != LOCAL and '://' not in arguments.scheduler:
        raise UserError(
            f'--scheduler {arguments.scheduler}: must be local, or an address as tcp://HOST:8786'
        )
    here = program()
    with on_scheduler(
        arguments.scheduler, program, lambda there: other_program(there, here)
    ) as refused:
        for line in refused:
            print(one_line(line), file=sys.stderr, flush=True)
        try:
            yield arguments.jobs
        finally:
            remove_abandoned()  # of processes that an interrupt has ended at their work


def check_positive(arguments: Namespace, *names: str) -> None:
    """Raise UserError if a number that one of the options gives is not above 0 and finite."""
    for name in names:
        given = getattr(arguments, name)
        for value in given if isinstance(given, list) else [given]:
            if value is not None and not 0 < value < math.inf:
                raise UserError(f'--{name.replace("_", "-")} {value}: must be above 0 and finite')
