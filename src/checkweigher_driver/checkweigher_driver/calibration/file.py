# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calibration files, which are ROS parameter files.

The older versions of a calibration file are kept in its folder.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
import os
from pathlib import Path
import re
import sysconfig
from typing import Any, cast

from ament_index_python import get_packages_with_prefixes
import yaml

from checkweigher_core.parameters import ParameterError, check_sections, flatten, in_section
from checkweigher_core.records import GRAMS
from checkweigher_core.settings_files import plain
from checkweigher_core.state_files import sync_folder
from checkweigher_core.whole_file import check_folder_of, output_error, write_whole
from checkweigher_core.yaml_files import opened
from checkweigher_driver.calibration.static_calibration import (
    CalibrationError,
    CalibrationPoint,
    StaticCalibration,
)
from checkweigher_driver.devices import SOURCES, source_class

_FIRST_LINE = '# Made by checkweigher calibrate, version '


def check_calibration_file(path: Path) -> None:
    """Raise CalibrationError or OutputError if a calibration cannot be written to a path.

    If the file exists already, it must be a calibration file. A file in an installed package is
    refused, because the next installation would replace it.
    """
    check_not_installed(path)
    if path.is_dir():
        raise CalibrationError(f'{path}: is a folder, must be a file')
    check_folder_of(path)
    if path.exists():
        read_version(path)


def check_not_installed(path: Path) -> None:
    """Raise CalibrationError if a path lies in an installed package."""
    for tree in _installed():
        if any(each.is_relative_to(tree) for each in (path.absolute(), path.resolve())):
            raise CalibrationError(
                f'{path}: lies in the installed packages in {tree}; choose another folder, such as '
                '/etc/checkweigher, because the next installation would replace the file'
            )


def _installed() -> list[Path]:
    packages = set(get_packages_with_prefixes().values())
    trees = map(Path, (sysconfig.get_path('purelib'), '/opt/ros', *packages))
    return [each for tree in trees for each in {tree.absolute(), tree.resolve()}]


def read_version(path: Path) -> int:
    """Return the version of a calibration file.

    Raises CalibrationError if the file is not a calibration file or cannot be read.
    """
    try:
        with path.open(encoding='utf-8') as file:
            first = file.readline()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, 'strerror', None) or error
        raise CalibrationError(f'{path}: cannot be read: {why}') from None
    found = re.match(re.escape(_FIRST_LINE) + r'(\d+)\b', first)
    if found is None:
        raise CalibrationError(
            f'{path}: is not a calibration file, which begins with "{_FIRST_LINE}"; '
            'choose another file'
        )
    return int(found.group(1))


def calibration_table(
    calibration: StaticCalibration, points: Sequence[CalibrationPoint]
) -> list[str]:
    """Return lines of text with the values of a calibration and a table of its points."""
    lines = [
        f'counts_per_kg {calibration.counts_per_kg:.4f} +- '
        f'{calibration.counts_per_kg_uncertainty:.4f} 1/kg, zero_counts '
        f'{calibration.zero_counts:.2f} +- {calibration.zero_uncertainty:.2f} (standard '
        'uncertainties)',
        f'{"mass g":>12}{"reading":>14}{"+-":>9}{"residual g":>13}{"+- g":>9}',
    ]
    for point, residual in zip(points, calibration.residuals, strict=True):
        uncertainty = abs(point.reading_uncertainty / calibration.counts_per_kg)
        lines.append(
            f'{GRAMS * point.mass:12.3f}{point.reading:14.2f}{point.reading_uncertainty:9.2f}'
            f'{GRAMS * residual:13.4f}{GRAMS * uncertainty:9.4f}'
        )
    return lines


def write_version(
    path: Path,
    source: str,
    calibration: StaticCalibration,
    points: Sequence[CalibrationPoint],
    base: Path | None = None,
) -> int:
    """Write a calibration as the newest version of a file, and return the version number.

    The previous version N of ``NAME.yaml`` is kept as ``NAME.vN.yaml``, or with a higher number if
    this file has other content. Other parameters are copied from the file `base` or, by default,
    from the previous version, if there is one. `source` is the name of the source whose parameters
    are set. Raises CalibrationError or OutputError if the file cannot be written, and SettingsError
    if the copied parameters are invalid. After an error, an existing file is unchanged.
    """
    check_calibration_file(path)
    old = read_version(path) if path.exists() else None
    sections = _sections(base if base is not None else path if old else None)
    driver = sections.setdefault('/**/driver', {}).setdefault('ros__parameters', {})
    driver.setdefault(source, {}).update(
        counts_per_kg=calibration.counts_per_kg, zero_counts=calibration.zero_counts
    )
    if old is not None:
        _keep(path, old)
    version = max([0, *_kept_versions(path)]) + 1
    lines = [
        f'{_FIRST_LINE}{version}; use it as --params, or as params_file of a launch.',
        f'# {datetime.now(UTC).isoformat(timespec="seconds")}',
        *(f'# {line}' for line in calibration_table(calibration, points)),
        yaml.safe_dump(sections, sort_keys=False, width=100),
    ]
    write_whole(path, '\n'.join(lines))
    return version


def replace_version(path: Path, new: Path) -> int:
    """Replace a file by another file, and return the version number of the new content.

    The old file ``NAME.yaml`` is kept as ``NAME.vN.yaml``, where N is the next free version number.
    Raises OutputError, and replaces nothing, if the old file cannot be kept. Raises OSError if
    `new` cannot be moved to `path`.
    """
    if path.exists():
        _keep(path, max([0, *_kept_versions(path)]) + 1)
    version = max([0, *_kept_versions(path)]) + 1
    os.replace(new, path)
    sync_folder(path.parent)
    return version


def _keep(path: Path, version: int) -> None:
    """Keep a file as a version, or as the next one if another file is kept as this version.

    An earlier attempt that was interrupted may have kept the same content already.
    """
    kept = path.with_name(f'{path.stem}.v{version}{path.suffix}')
    try:
        if not kept.exists():
            os.link(path, kept)
        elif kept.read_bytes() != path.read_bytes():
            _keep(path, version + 1)
    except OSError as error:
        raise output_error(kept, error) from None


def _kept_versions(path: Path) -> list[int]:
    pattern = re.compile(re.escape(path.stem) + r'\.v(\d+)' + re.escape(path.suffix))
    found = (pattern.fullmatch(other.name) for other in path.parent.iterdir())
    return [int(match.group(1)) for match in found if match]


def _sections(path: Path | None) -> dict[str, Any]:
    if path is None:
        return {}
    with opened(path) as sections:
        check_sections(sections)
    return cast(dict[str, Any], plain(sections))


def source_values(path: Path, source: str) -> dict[str, object]:
    """Return the values that a parameter file sets for the parameters of a source, by name.

    Raises SettingsError if the file is invalid or cannot be read.
    """
    with opened(path) as sections:
        return _values_of(sections, source)


def _values_of(sections: Any, source: str) -> dict[str, object]:
    found: dict[str, object] = {}
    for address, values in check_sections(sections).items():
        if str(address).rsplit('/', 1)[-1] in ('**', 'driver'):
            found.update(flatten(values))
    prefix = f'{source}.'
    return {n.removeprefix(prefix): value for n, value in found.items() if n.startswith(prefix)}


def calibrated_sources() -> list[str]:
    """Return the names of the sources with calibration parameters.

    For example, a bag has no calibration parameters. Raises ParameterError if a package that a
    source needs is not installed.
    """
    return [name for name in SOURCES if _is_calibrated(name)]


def _is_calibrated(source: str) -> bool:
    return {'counts_per_kg', 'zero_counts'} <= set(source_class(source).parameters.entries())


def check_calibrated_source(source: str) -> None:
    """Raise CalibrationError if a source, such as a bag, has no calibration parameters."""
    if not _is_calibrated(source):
        raise CalibrationError(f'source {source}: its data contain the calibration')


def read_calibration(path: Path, source: str) -> tuple[float, float] | None:
    """Return counts_per_kg and zero_counts of a source, or None without a calibration file.

    The result is also None if the source has no calibration parameters. Raises CalibrationError or
    SettingsError if the file is not a calibration of this source.
    """
    if 'counts_per_kg' not in source_class(source).parameters.entries() or not path.exists():
        return None
    read_version(path)
    found = []
    with opened(path) as sections:
        values = _values_of(sections, source)
        for name in ('counts_per_kg', 'zero_counts'):
            value = values.get(name)
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise in_section(
                    ParameterError(f'driver.{source}.{name}: {value!r} is not a number'), sections
                )
            found.append(float(value))
    return found[0], found[1]
