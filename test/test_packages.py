# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Each package says what it is and what it needs, as the ROS tools read it."""

import ast
from collections.abc import Iterable
from email.utils import parsedate_to_datetime
from pathlib import Path
import re
import shutil
import subprocess
import sys
from xml.etree import ElementTree

from catkin_pkg.package import Package, parse_package
from docutils.core import publish_doctree
import pytest
from running import ROOT
import yaml

PACKAGES = sorted(path.parent for path in ROOT.glob('src/*/package.xml'))
FOLDERS = 'test/support', 'test/support/devices', 'bench'
SUPPORT = {path.stem: path for folder in FOLDERS for path in (ROOT / folder).glob('*.py')}
# The rosdep key of a module, where its name is another one.
KEYS = {
    # These come with NiceGUI.
    'fastapi': 'nicegui',
    'starlette': 'nicegui',
    'uvicorn': 'nicegui',
    'argon2': 'python3-argon2',
    'babel': 'python3-babel',
    'cryptography': 'python3-cryptography',
    'distributed': 'python3-distributed',
    'filterpy': 'python3-filterpy-pip',
    'fsspec': 'python3-fsspec',
    'hypothesis': 'python3-hypothesis',
    'jinja2': 'python3-jinja2',
    'markupsafe': 'python3-jinja2',  # which returns its type
    'matplotlib': 'python3-matplotlib',
    'google': 'python3-protobuf',
    'numpy': 'python3-numpy',
    'paho': 'python3-paho-mqtt',
    'prometheus_client': 'python3-prometheus-client',
    'pytest': 'python3-pytest',
    'pywt': 'python3-pywt',
    'ruamel': 'python3-ruamel.yaml',
    'scipy': 'python3-scipy',
    'selenium': 'python3-selenium',
    'websocket': 'python3-selenium',  # comes with it
    'serial': 'python3-serial',
    'tqdm': 'python3-tqdm',
    'yaml': 'python3-yaml',
}
# Imported where it is installed, and asked for: a cluster is not for everybody.
OPTIONAL = {'python3-distributed'}
# What bloom can release: apt has all that these packages name.
RELEASED = [
    'checkweigher_msgs', 'checkweigher_core', 'checkweigher_dsp', 'checkweigher_production',
    'checkweigher_driver',
]  # fmt: skip
# What a released package imports only for a source or an estimator that asks for it.
ASKED_FOR = {
    'checkweigher_driver': {'checkweigher_recording', 'gpiod', 'pymodbus'},
    'checkweigher_dsp': {'python3-filterpy-pip'},
}
LINTERS = {'ament_flake8', 'ament_pep257', 'ament_xmllint'}
# Needed, but not imported.
BESIDE = {
    'checkweigher_bringup': {'gpiod', 'pymodbus', 'python3-filterpy-pip', 'ros2launch'},
    'checkweigher_driver': {'checkweigher_production', 'ros2launch'},
    'checkweigher_msgs': {
        'action_msgs', 'builtin_interfaces', 'rosidl_default_runtime', 'std_msgs',
        'ament_lint_auto', 'ament_lint_common',
    },
    # It reads the definitions of the messages.
    'checkweigher_recording': {
        'builtin_interfaces', 'checkweigher_msgs', 'diagnostic_msgs', 'std_msgs',
    },
}  # fmt: skip
# The order of the schema, http://download.ros.org/schema/package_format3.xsd.
ORDER = (
    'name', 'version', 'description', 'maintainer', 'license', 'url', 'author', 'depend',
    'member_of_group', 'export',
)  # fmt: skip

each_package = pytest.mark.parametrize('folder', PACKAGES, ids=lambda folder: folder.name)


@each_package
def test_a_package_is_valid(folder: Path):
    warnings: list[str] = []
    package = parse_package(str(folder), warnings=warnings)
    package.validate(warnings=warnings)
    assert not warnings
    assert (package.name, package.package_format) == (folder.name, 3)
    assert package.licenses == ['Apache-2.0']
    (maintainer,) = package.maintainers
    control = (ROOT / 'debian/control').read_text(encoding='utf-8')
    assert f'\nMaintainer: {maintainer.name} <{maintainer.email}>\n' in control
    tags = [child.tag for child in ElementTree.parse(folder / 'package.xml').getroot()]
    ranks = [ORDER.index('depend' if tag.endswith('_depend') else tag) for tag in tags]
    assert ranks == sorted(ranks)


@each_package
def test_a_package_names_what_its_sources_import(folder: Path):
    package = parse_package(str(folder))
    imported = _keys([*folder.glob(f'{folder.name}/**/*.py'), *folder.glob('launch/*.py')])
    needed = _names(package, 'exec_depends')
    imported -= {folder.name, *OPTIONAL, *ASKED_FOR.get(folder.name, ())}
    assert needed - BESIDE.get(folder.name, set()) == imported


@each_package
def test_a_package_names_what_its_tests_import(folder: Path):
    package = parse_package(str(folder))
    tests = list(folder.glob('test/**/*.py'))
    imported = _keys([*tests, ROOT / 'conftest.py']) if tests else set()
    needed = _names(package, 'test_depends') - BESIDE.get(folder.name, set())
    if tests:
        imported |= LINTERS
    imported -= ASKED_FOR.get(folder.name, set()) | {folder.name}
    assert needed == imported - _names(package, 'exec_depends')


def _names(package: Package, kind: str) -> set[str]:
    return {str(dependency.name) for dependency in getattr(package, kind)}


def _keys(paths: Iterable[Path]) -> set[str]:
    """Return the rosdep keys of all that modules import, through the support of the tests."""
    seen: set[Path] = set()
    keys: set[str] = set()
    left = list(paths)
    while left:
        path = left.pop()
        if path in seen:
            continue
        seen.add(path)
        for name in _imported(path) - sys.stdlib_module_names:
            if name in SUPPORT:
                left.append(SUPPORT[name])
            else:
                keys.add(KEYS.get(name, name))
    return keys


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split('.')[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split('.')[0])
    return names


def test_keys_that_rosdep_lacks_are_in_the_list_of_the_workspace():
    own = yaml.safe_load((ROOT / 'rosdep.yaml').read_text(encoding='utf-8'))
    needed = {
        name
        for folder in PACKAGES
        for kind in ('exec_depends', 'test_depends')
        for name in _names(parse_package(str(folder)), kind)
    }
    assert set(own) <= needed
    # These are in rosdep's own list, base.yaml or python.yaml of rosdistro.
    listed = set(KEYS.values()) - {'python3-pywt'}
    of_ros = needed - listed - set(own)
    assert not {name for name in of_ros if name.startswith('python3-')}
    assert of_ros.isdisjoint({'gpiod', 'mcap', 'pymodbus', 'rosbags'})


def test_a_released_package_needs_nothing_of_pip():
    own = yaml.safe_load((ROOT / 'rosdep.yaml').read_text(encoding='utf-8'))
    by_pip = {name for name, rules in own.items() if 'pip' in rules['ubuntu']}
    for name in RELEASED:
        package = parse_package(str(ROOT / 'src' / name))
        needed = _names(package, 'exec_depends') | _names(package, 'test_depends')
        assert not {key for key in needed if key in by_pip or key.endswith('-pip')}
        assert {key for key in needed if key.startswith('checkweigher_')} < {*RELEASED}


@each_package
def test_a_package_has_its_changelog(folder: Path):
    text = (folder / 'CHANGELOG.rst').read_text(encoding='utf-8')
    tree = publish_doctree(text, settings_overrides={'halt_level': 2, 'doctitle_xform': False})
    (package,) = tree.children
    title, *versions = package.children
    assert title.astext() == f'Changelog for package {folder.name}'
    heads = [version.children[0].astext() for version in versions]
    assert {version.children[1].tagname for version in versions} == {'bullet_list'}
    numbered = heads[1:] if heads[0] == 'Forthcoming' else heads
    assert numbered[0] == ' '.join(_released())


def _released() -> tuple[str, str]:
    """Return version and date of the packages, the date as that of the Debian package."""
    (version,) = {str(parse_package(str(folder)).version) for folder in PACKAGES}
    changelog = (ROOT / 'debian/changelog').read_text(encoding='utf-8')
    assert changelog.startswith(f'checkweigher ({version}) ')
    dated = re.search(r'^ -- .*>  (.*)$', changelog, re.MULTILINE)
    assert dated
    return version, f'({parsedate_to_datetime(dated[1]).date()})'


def test_a_python_that_a_user_cannot_run_is_named(tmp_path: Path):
    shutil.copytree(ROOT / 'setup', tmp_path / 'setup')
    shutil.copytree(ROOT / 'requirements', tmp_path / 'requirements')
    (tmp_path / '.venv/bin').mkdir(parents=True)
    (tmp_path / '.venv/.stamp').touch()
    (tmp_path / '.venv/pyvenv.cfg').write_text('home = /root/python/bin\n')
    (tmp_path / '.setup.lock').mkdir()  # which not even root can write to
    done = subprocess.run(tmp_path / 'setup/bootstrap', capture_output=True, text=True)
    assert (done.returncode, done.stderr.count('\n')) == (2, 1)
    assert 'cannot run the Python of the environment, in /root/python/bin; let ' in done.stderr


@each_package
def test_setup_says_the_same_as_package_xml(folder: Path):
    if not (folder / 'setup.py').exists():
        return
    package = parse_package(str(folder))
    call = next(
        node for node in ast.walk(ast.parse((folder / 'setup.py').read_text(encoding='utf-8')))
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'setup'
    )  # fmt: skip
    told = {
        entry.arg: entry.value.value
        for entry in call.keywords
        if isinstance(entry.value, ast.Constant)
    }
    (maintainer,) = package.maintainers
    assert told['version'] == package.version
    assert told['description'] == package.description
    assert told['license'] in package.licenses
    assert (told['maintainer'], told['maintainer_email']) == (maintainer.name, maintainer.email)


def test_each_source_names_its_copyright_and_licence():
    header = '# Copyright 2026 Checkweigher maintainers\n# SPDX-License-Identifier: Apache-2.0\n'
    folders = ('src', 'test', 'bench', 'docs')
    sources = [path for folder in folders for path in (ROOT / folder).rglob('*.py')]
    assert len(sources) > 200
    assert [str(path) for path in sources if not path.read_text().startswith(header)] == []


@each_package
def test_a_package_has_licence_and_quality_declaration(folder: Path):
    assert (folder / 'LICENSE').read_bytes() == (ROOT / 'LICENSE').read_bytes()
    text = (folder / 'QUALITY_DECLARATION.md').read_text(encoding='utf-8')
    version = str(parse_package(str(folder)).version)
    stable = int(version.partition('.')[0]) >= 1
    assert f'| 1.ii stable version | {"yes" if stable else "no"}: {version} |' in text
    answers = re.findall(
        r'^\| (?:\d\.[iv]+(?:, )?)+ .*? \| (yes|no|none|measured)\b', text, re.MULTILINE
    )
    assert len(answers) == text.count('\n| ') - 1


def _locked(name: str) -> set[str]:
    """Return the entries of a lock: name, version, condition and hashes."""
    text = (ROOT / 'requirements' / name).read_text(encoding='utf-8')
    return set(re.split(r'\n(?=\S)', re.sub(r'^#.*\n', '', text, flags=re.MULTILINE).strip()))


def test_what_is_installed_for_a_line_is_part_of_what_is_tested():
    assert _locked('runtime.lock') < _locked('requirements.lock')
