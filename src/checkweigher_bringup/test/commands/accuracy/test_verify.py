# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Verifications from recorded steps: one simulated machine passes, another one fails."""

from dataclasses import asdict, replace
import hashlib
import json
from pathlib import Path
from typing import Any

from here import run_here
from made_procedure import PLAN
import numpy as np
import pytest
from recorded_steps import record_steps

from checkweigher_bringup.cli import build_parser
from checkweigher_bringup.commands.accuracy import verify as verify_command
from checkweigher_bringup.settings import line_parameters
from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, SampleBlock
from checkweigher_core.ros import ports
from checkweigher_production.audit_log import AuditLog
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.bags.results import mcap_digest, read_records
from checkweigher_recording.bags.writing import BagWriter, write_bag
from checkweigher_validation.accuracy.results import weigh
from checkweigher_validation.verification.plan import EXAMPLE

PASSES = 12
FEW = PLAN.replace('passes: 3', f'passes: {PASSES}')
# Beyond the range of dynamic setting, which is up to 2 m/s here, there is no mass.
PARAMETERS = '/**/reject:\n  ros__parameters:\n    max_speed: 2.0\n'


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    """Return the plan of a verification with few passes."""
    (tmp_path / 'line.yaml').write_text(PARAMETERS)
    path = tmp_path / 'plan.yaml'
    path.write_text(FEW)
    return path


def verify(plan: Path, bags: list[Path], output: Path, *more: object) -> tuple[int, dict[str, Any]]:
    """Verify from bags, and return the exit status and the report."""
    parameters = plan.with_name('line.yaml')
    status = run('verify', plan, '--bags', *bags, '--params', parameters, '--output', output, *more)
    return status, json.loads((output / 'report.json').read_text())


def run(*words: object) -> int:
    """Run the command in this process without catching its errors."""
    return verify_command.run(build_parser().parse_args([str(word) for word in words]))


def test_a_machine_of_its_class_passes_and_its_bag_gives_the_report_again(
    plan: Path, tmp_path: Path
):
    bags = record_steps(tmp_path / 'steps', FEW)
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        cell = asdict(read_bag(bags[0]).load_cell) | {'zero_counts': 1.0}
        audit.append('2026-05-28T19:00:00', '/driver', 'calibration', 'info', None, cell)
        last = audit.append('2026-05-28T20:00:00', '/reject', 'parameter', 'max_speed', 3.0, 2.0)
    status, report = verify(plan, bags, tmp_path / 'out', '--audit', log)
    # Each step has passed, but with few weighings, and no zeroing was recorded.
    assert (status, report['verdict']) == (1, 'incomplete')
    assert 'Step passes_60_small has 12 weighings, 60 are required.' in report['departures']
    assert any('had no zeroing before it' in each for each in report['departures'])
    assert (
        'The line has simulated S-1, but the plan has load cell LC-1 and amplifier AD-1.'
        in (report['departures'])
    )
    assert (
        'The samples have another calibration than the audit log of the machine.'
        in (report['departures'])
    )
    assert not any('mass' in each for each in report['departures'])
    assert report['counts'] == {'passed': len(bags), 'failed': 0, 'not_made': 0}

    # What `weigh` says of each bag alone, with the statistics of numpy.
    compared = 0
    for bag, step in zip(bags, report['steps'], strict=True):
        assert bag.name == step['name']
        if step['reading'] or step['test'].startswith('outside'):
            continue
        items = weigh(read_bag(bag), line_parameters(tmp_path / 'line.yaml', None))
        errors = np.array([1000 * (item.estimate.mass - item.reference) for item in items])
        assert step['count'] == len(errors) == PASSES
        assert step['error_g'] == pytest.approx(np.mean(errors), abs=2e-6)
        assert step['std_dev_g'] == pytest.approx(np.std(errors, ddof=1), abs=2e-6)
        stated = np.array([1000 * item.estimate.std_dev for item in items])
        assert step['coverage_95'] == pytest.approx(np.mean(abs(errors) <= 1.96 * stated), abs=1e-4)
        compared += 1
    assert compared == 7

    assert report['identity']['audit_log_last_hash'] == last.hash
    digests = report['digests']
    for name, file in (
        ('bag', 'out/bag/line_0.mcap'), ('plan', 'plan.yaml'), ('audit_log', 'audit.log'),
        ('parameters', 'out/parameters.yaml'),
    ):  # fmt: skip
        assert digests[name] == hashlib.sha256((tmp_path / file).read_bytes()).hexdigest(), name

    # The same from the bag alone, which lies elsewhere by then.
    plan.unlink()
    (tmp_path / 'out' / 'bag').rename(tmp_path / 'kept')
    done = run_here('verify', '--from', tmp_path / 'kept', '--output', tmp_path / 'again')
    assert (done.returncode, done.stderr) == (1, '')  # incomplete, as before
    for name in ('report.html', 'report.json'):
        assert (tmp_path / 'again' / name).read_bytes() == (tmp_path / 'out' / name).read_bytes()


def test_a_machine_that_shows_too_much_fails_where_it_does(plan: Path, tmp_path: Path):
    # 0.15 % of 194.5 g are 0.29 g, where 0.1 g is allowed; the zero drifts 0.03 g a step.
    bags = record_steps(tmp_path / 'steps', FEW, gain=1.0015, drift=3e-5)
    left_out = [bag for bag in bags if bag.name != 'eccentricity_right']
    status, report = verify(plan, left_out, tmp_path / 'out')
    assert (status, report['verdict']) == (1, 'failed')
    verdicts = {step['name']: step['verdict'] for step in report['steps']}
    assert verdicts['passes_60_middle'] == verdicts['static_up_large'] == 'failed'
    assert verdicts['zero_after'] == 'failed'
    assert verdicts['repeatability'] == verdicts['outside_1'] == 'passed'
    assert report['counts']['not_made'] == 1
    assert 'Step eccentricity_right was not made.' in report['departures']
    shown = (tmp_path / 'out' / 'report.html').read_text()
    assert '<p class="verdict failed">failed</p>' in shown


def test_masses_that_are_not_those_of_the_samples_are_told(plan: Path, tmp_path: Path):
    bags = record_steps(tmp_path / 'steps', FEW, ('passes_60_middle',))
    verify(plan, bags, tmp_path / 'out')
    made = tmp_path / 'out' / 'bag'
    results = ports.VERIFICATION, ports.MASS_ESTIMATE, ports.VERDICT
    found, recording = read_records(made, *results), read_bag(made)
    begin = found[ports.VERIFICATION.name][0].stamp
    samples = {SampleBlock: ports.LOAD_CELL_SAMPLES, EyeEdge: ports.PHOTO_EYES}
    records: list[tuple[int, ports.Port, Any]] = [
        (begin, ports.LOAD_CELL_INFO, recording.load_cell),
        *((each.stamp, samples[type(each)], each) for each in recording if type(each) in samples),
        *(
            (getattr(e, 'stamp', None) or e.t3, port, e)
            for port in results
            for e in found[port.name]
        ),
    ]
    both = ports.VERDICT, ports.MASS_ESTIMATE
    for name, by, patched, told in (
        ('mass', 6e-5, both[:1], 'Verdicts with another mass than their estimate (12): item 1: '),
        ('mass', 6e-5, both, 'Masses that are not those of the samples (12): '),
        ('zero', 1e-3, both[1:], 'Zeros that are not those of the samples (12): '),
    ):
        forged = tmp_path / f'forged_{name}_{len(patched)}'
        with BagWriter(forged, ports.RECORDED) as writer:
            for stamp, port, record in sorted(records, key=lambda each: each[0]):
                off = {name: getattr(record, name) + by} if port in patched else {}
                writer.put_record(port, stamp, replace(record, **off) if off else record)
        done = run_here('verify', '--from', forged, '--output', tmp_path / f'{forged.name}_report')
        report = json.loads((tmp_path / f'{forged.name}_report/report.json').read_text())
        assert any(told in each for each in report['departures']), report['departures']
    log = tmp_path / 'audit.log'
    with AuditLog(log) as audit:
        value = {'verdict': 'passed', 'bag': mcap_digest(forged)}
        audit.append('2026-05-28', '/product', 'verification', 'v', None, value)
    for bag, said in ((forged, 'but it was passed'), (tmp_path / 'out/bag', 'no verification')):
        again = tmp_path / f'again {said}'
        done = run_here('verify', '--from', bag, '--log', log, '--output', again)
        assert (done.returncode, said in done.stdout) == (1, True), done.stdout


def test_a_fault_that_is_a_pass_of_no_step_is_in_the_report(plan: Path, tmp_path: Path):
    bags = record_steps(tmp_path / 'steps', FEW, ('zero_1', 'zero_2'))
    empty, touched = read_bag(bags[1]), tmp_path / 'touched' / 'zero_2'
    touched.parent.mkdir()
    at = empty.blocks[0].stamp + 2 * NANOSECONDS
    hand = (EyeEdge(at, Eye.INFEED, True), EyeEdge(at + NANOSECONDS // 10, Eye.INFEED, False))
    write_bag(touched, empty.load_cell, Recording.from_events(empty.load_cell, (*empty, *hand)))
    _, report = verify(plan, [bags[0], touched], tmp_path / 'out')
    assert [step['verdict'] for step in report['steps']] == ['passed', 'passed']
    (fault,) = report['faults_between']
    assert fault['after'] == 'zero_2'
    assert fault['time'] > report['steps'][1]['end']
    (reason,) = fault['reasons']
    assert reason in (tmp_path / 'out' / 'report.html').read_text()


def test_bags_that_are_of_no_one_procedure_are_refused(plan: Path, tmp_path: Path):
    names = ('zero_1', 'zero_2', 'passes_60_small')
    by_name = {bag.name: bag for bag in record_steps(tmp_path / 'steps', PLAN, names)}
    swapped = tmp_path / 'swapped'
    swapped.mkdir()
    by_name['passes_60_small'].rename(swapped / 'passes_60_middle')
    strange = tmp_path / 'lunch'
    by_name['zero_2'].rename(strange)
    later = record_steps(tmp_path / 'other', PLAN, (*names, 'zero_after'), gain=1.01)[-1]
    for given, message in (
        ([strange], 'the name is not a step of the plan'),
        ([swapped / 'passes_60_middle'], 'its reference_mass is 74.5 g, but in the plan middle'),
        ([by_name['zero_1'], by_name['zero_1']], 'begins before'),
        ([by_name['zero_1'], later], 'has another calibration than'),
    ):
        with pytest.raises(ValueError, match=message):
            run('verify', plan, '--bags', *given, '--output', tmp_path / 'out')
        assert not (tmp_path / 'out').exists()


def test_what_cannot_be_verified_is_one_line(plan: Path, tmp_path: Path):
    (recorded,) = record_steps(tmp_path / 'steps', PLAN, ('zero_1',))
    for words, message in (
        (('verify', '--output', 'x'), 'either PLAN or --from BAG'),
        (('verify', plan, '--params', plan), '--output: must be given'),
        (('verify', '--from', recorded, '--output', tmp_path / 'x'), 'contains no verification'),
        (('verify', '--from', tmp_path, '--output', tmp_path / 'x'), 'contains no verification'),
        (('verify', tmp_path / 'none.yaml', '--output', tmp_path / 'x'), 'No such file'),
        (('verify', plan, '--output', tmp_path), 'exists already'),
        (('verify', plan, '--params', plan, '--output', tmp_path / 'x'), 'only with --bags'),
    ):
        with pytest.raises((ValueError, OSError), match=message):
            run(*words)
    assert not (tmp_path / 'x').exists()


def test_the_example_and_its_steps_are_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):  # fmt: skip
    assert run('verify', '--example') == 0
    shown = capsys.readouterr().out
    assert shown == EXAMPLE
    (tmp_path / 'plan.yaml').write_text(shown)
    assert run('verify', tmp_path / 'plan.yaml', '--steps') == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ['warm_up_zero_0', 'reading', 'Leave', 'the', 'belt', 'empty']
    (line,) = (line for line in lines if line.startswith('passes_30_small'))
    assert '  60 passes  Run the belt at 30 m/min and let one product pass, because ' in line
    assert line.endswith('; once the step has begun, let small (74.5 g) pass')
