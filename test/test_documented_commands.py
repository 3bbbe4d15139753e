# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands in the docs: each exists, with its options.

`OFFLINE` lists those that are run here as they are printed; tests of each command run it with other
arguments. A block that needs more than the project is marked by a comment before it,
`<!-- not run: REASON -->`. test_own_nodes.py runs the programs in Python.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
import re
import shlex
import shutil

from here import run_here
import make_docs
import pytest
from running import BAGS, ROOT
import yaml

from checkweigher_bringup.cli import build_parser
from checkweigher_core.ros import ports
from checkweigher_core.ros.services import ACTIONS, LIFE_CYCLE_NODES, SERVICES

PAGES = [*ROOT.glob('*.md'), *ROOT.glob('docs/*.md'), *ROOT.glob('src/*/*.md')]
LAUNCH = (ROOT / 'src/checkweigher_bringup/launch/line.launch.py').read_text(encoding='utf-8')
PARAMETERS = {
    prefix + name for prefix, parameters in make_docs.SETS.values() for name in parameters.entries()
}
# First words of a line by which a block is one of commands.
PROGRAMS = (
    'apt', 'checkweigher', 'colcon', 'curl', 'echo', 'for', 'make', 'mosquitto_sub', 'openssl',
    'packaging/', 'pip', 'podman', 'printf', 'pytest', 'python', 'ros2', 'rosdep', 'setup/',
    'source', 'ssh', 'systemctl', 'tar',
)  # fmt: skip
OFFLINE = """
checkweigher simulate --speed 60 --mass 134.5 --count 20 --output line
checkweigher weigh my_bag --csv masses.csv
checkweigher keep shift1 --item 17 --output item17
checkweigher batch bags/paper_60 --recipes recipes.yaml --product crisps_150g
checkweigher verify --example > plan.yaml
checkweigher verify plan.yaml --steps
checkweigher policy --namespace lane1 lane2 --output policy.xml
checkweigher certificate scale7.local 192.168.1.7 --certificate page.crt --key page.key
""".strip().splitlines()


def command_blocks(page: Path) -> Iterator[tuple[bool, list[list[str]]]]:
    """Yield whether a block of commands is marked, and the words of each of its commands."""
    text = page.read_text(encoding='utf-8')
    for block in re.finditer(r'(?:^|\n)\n((?: {4}.*\n|\n(?= {4}))+)', text):
        if re.match(rf'(sudo )?(\./)?({"|".join(PROGRAMS)})|[a-z]+="', block[1].strip()):
            marked = re.search(r'<!-- not run: [^>]+ -->\s*\Z', text[: block.start(1)]) is not None
            yield marked, list(commands(block[1]))


def commands(block: str) -> Iterator[list[str]]:
    """Yield the words of each command of a block, with those of a redirection."""
    for line in re.sub(r'\\\n', ' ', block).splitlines():
        words = shlex.shlex(line, posix=True, punctuation_chars=';&|')
        words.whitespace_split = True
        command: list[str] = []
        for word in [*words, ';']:
            if word[0] not in ';&|':
                command.append(word)
            elif command:
                yield command
                command = []


def check(command: list[str]) -> None:
    """Check a command against the code; a program of others raises `KeyError`."""
    program, *arguments = command[1:] if command[0] == 'sudo' else command
    if program.startswith(('setup/', 'packaging/')):
        assert (ROOT / program).exists(), program
        return
    CHECKS[program.removeprefix('./')](arguments)


def check_own(arguments: list[str]) -> None:
    """Check a command of the project: its options, and those that it needs."""
    ends = [arguments.index(sign) for sign in '<>' if sign in arguments]
    if arguments != ['--help']:
        build_parser().parse_args(arguments[: min(ends, default=None)])


def check_make(arguments: list[str]) -> None:
    """Check a target of the Makefile."""
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    assert re.search(rf'^{arguments[0]}:', makefile, re.MULTILINE), arguments


def check_python(arguments: list[str]) -> None:
    """Check that a program in Python, or the file of a test, is there, or printed by a page."""
    (name,) = [argument for argument in arguments if argument.endswith('.py')]
    printed = {'own_driver.py', 'own_plc.py', 'span_correction.py'}
    assert name in printed or (ROOT / name).exists(), name


def check_fields(message: object, given: list[str]) -> None:
    """Check that a message has the fields of a request in YAML, if there is one."""
    for field, value in yaml.safe_load(given[0] if given else '{}').items():
        setattr(message, field, value)


def check_ros2(arguments: list[str]) -> None:
    """Check node, launch argument, topic, parameter, or service with its request."""
    match arguments:
        case ['run', package, executable, *_]:
            setup = (ROOT / 'src' / package / 'setup.py').read_text(encoding='utf-8')
            assert f"'{executable} = {package}." in setup, executable
        case ['launch', 'checkweigher_bringup', 'line.launch.py', *given]:
            for argument in given:
                assert f"\n    '{argument.partition(':=')[0]}': " in LAUNCH, argument
        case ['topic', 'echo', name, kind]:
            known = (*ports.ALL, ports.DYNAMIC_SETTING)
            assert kind in {
                p.message_type for p in known if name in (f'/{p.name}', f'/lane1/{p.name}')
            }
        case ['param', 'set', _, name, _]:
            assert name in PARAMETERS
        case ['lifecycle', 'set', node, 'configure' | 'activate']:
            assert node[1:] in LIFE_CYCLE_NODES
        case ['service', 'call', name, kind, *request]:
            assert kind == next(each.kind for each in SERVICES if each.name == name[1:])
            check_fields(ports.interface(kind).Request(), request)
        case ['action', 'send_goal', '--feedback', name, kind, *goal]:
            assert kind == next(each.kind for each in ACTIONS if each.name == name[1:])
            check_fields(ports.interface(kind).Goal(), goal)
        case _:
            raise KeyError(arguments)


CHECKS: dict[str, Callable[[list[str]], None]] = {
    'checkweigher': check_own,
    'make': check_make,
    'python': check_python,
    'python3': check_python,
    'pytest': check_python,
    'ros2': check_ros2,
    'source': lambda _: None,
}


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_each_command_in_the_docs_is_there_or_marked(page: Path):
    for marked, block in command_blocks(page):
        if not marked:
            for command in block:
                check(command)


def test_commands_that_need_no_graph_run_as_they_are_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    printed = [' '.join(c) for page in PAGES for _, block in command_blocks(page) for c in block]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    shutil.copyfile(ROOT / 'src/checkweigher_bringup/config/recipes.yaml', 'recipes.yaml')
    for name, target in {'bags': '', 'my_bag': 'paper_60', 'shift1': 'paper_60'}.items():
        Path(name).symlink_to(BAGS / target)
    for line in OFFLINE:
        assert f'./{line}' in printed
        command, _, output = line.partition(' > ')
        done = run_here(*command.split()[1:])
        assert (done.returncode, done.stderr) == (0, ''), line
        if output:
            Path(output).write_text(done.stdout, encoding='utf-8')
