# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The family of machines: what is drawn, and what each cause does on and off."""

from dataclasses import asdict, fields, replace

from lines import counts_of, grams_of
import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Eye
from checkweigher_recording.simulation.machine import CAUSES, Machine, draw, machine_of
from checkweigher_recording.simulation.simulator import SimulationParameters, own_values, simulate

START = 1_700_000_000_000_000_000


def _line(profile, **values):
    own = own_values(profile) | {'count': 10, 'masses': (0.1, 0.2)} | values
    return simulate(SimulationParameters.from_mapping({'profile': profile, **own}))


def _only(seed, *causes):
    """Return the profile of a machine with no other causes than these."""
    return f'machine:{seed}-' + '-'.join(cause for cause in CAUSES if cause not in causes)


def _edges(recording, eye, blocked):
    return np.array(
        [e.stamp - START for e in recording.edges if (e.eye, e.blocked) == (eye, blocked)]
    ) / 1e9  # fmt: skip


def _with(monkeypatch, machine):
    """Have every profile of a machine mean this one."""
    monkeypatch.setattr(
        'checkweigher_recording.simulation.simulator.machine_of', lambda profile: machine
    )
    return 'machine:0'


def test_equal_seeds_give_equal_machines_and_equal_bytes():
    first, again = (_line('machine:5') for _ in range(2))
    np.testing.assert_array_equal(counts_of(first), counts_of(again))
    assert first.edges == again.edges
    assert draw(5) == draw(5) != draw(6)
    assert not np.array_equal(counts_of(first)[:900], counts_of(_line('machine:5', seed=2))[:900])


def test_the_first_products_do_not_depend_on_how_many_follow():
    short, long = (_line('machine:8', count=count) for count in (3, 9))
    common = len(counts_of(short)) - round(1.0 * short.load_cell.sample_rate) - 60
    np.testing.assert_array_equal(counts_of(short)[:common], counts_of(long)[:common])
    assert short.edges == long.edges[:12]


@pytest.mark.parametrize('seed', range(1, 5))
def test_each_cause_changes_the_line_and_nothing_else_does(seed):
    whole = _line(f'machine:{seed}')
    for cause in CAUSES:
        less = _line(f'machine:{seed}-{cause}')
        same = np.array_equal(counts_of(whole), counts_of(less)) and whole.edges == less.edges
        assert same == (getattr(draw(seed), cause) is None), cause


def test_with_no_cause_a_product_reads_its_mass():
    # A belt of 10 m: the product is fully on for about 10 s.
    bare = _line(_only(3), count=1, masses=(0.2,), weigh_length=10.0, spacing=21.0)
    t2, t3 = _edges(bare, Eye.INFEED, False)[0], _edges(bare, Eye.OUTFEED, True)[0]
    rate = bare.load_cell.sample_rate
    plateau = grams_of(bare)[round((t2 + 6) * rate) : round(t3 * rate) - 1]
    np.testing.assert_allclose(plateau, 200.0, rtol=0, atol=1000 / bare.load_cell.counts_per_kg)


@pytest.mark.parametrize('gain', [2.0, -1.0, 0.25])
def test_counts_are_in_proportion_to_the_sensitivity(gain):
    own = own_values('machine:4')['counts_per_kg']
    plain = _line('machine:4', zero_counts=0.0)
    scaled = _line('machine:4', zero_counts=0.0, counts_per_kg=gain * own)
    np.testing.assert_allclose(
        counts_of(scaled), gain * counts_of(plain), rtol=0, atol=1 + abs(gain)
    )


def test_disturbances_grow_with_the_mass_and_differ_from_pass_to_pass():
    # The bounce alone, of machines that differ in nothing else.
    for cause in ('transfer', 'bounce'):
        quiet, shaken = (_line(_only(2, *own), masses=(0.1, 0.1, 0.4, 0.4), count=40)
                         for own in ((), (cause,)))  # fmt: skip
        added = grams_of(shaken) - grams_of(quiet)
        rate = quiet.load_cell.sample_rate
        t1, t3 = _edges(quiet, Eye.INFEED, True), _edges(quiet, Eye.OUTFEED, True)
        passes = [added[round(a * rate) : round(b * rate)] for a, b in zip(t1, t3, strict=True)]
        size = np.array([piece.std() for piece in passes])
        light, heavy = size.reshape(-1, 2, 2).transpose(1, 0, 2).reshape(2, -1)
        power = getattr(draw(2), cause).power
        ratio = np.sqrt(np.mean(heavy**2) / np.mean(light**2))
        assert ratio == pytest.approx(4**power, rel=0.4), cause
        assert light.std() > 0.02 * light.mean(), cause


def test_the_corner_error_is_that_of_the_place():
    machine = draw(1)
    # Slow, so that the platform follows; short, so that the product is at one place.
    slow = {'speed': 0.02, 'product_length': 0.01, 'spacing': 5.0}
    line = _line(_only(1, 'corner'), count=1, masses=(0.2,), **slow)
    rate = line.load_cell.sample_rate
    t2, t3 = _edges(line, Eye.INFEED, False)[0], _edges(line, Eye.OUTFEED, True)[0]
    half = 1 - 0.01 / machine.setup.weigh_length
    for place, time in ((-half, t2), (0.0, (t2 + t3) / 2), (half, t3)):
        middle = round(time * rate) + (20 if time == t2 else -20 if time == t3 else 0)
        read = grams_of(line)[middle - 15 : middle + 15].mean()
        expected = 200 * (1 + machine.corner.linear * place + machine.corner.square * place**2)
        assert read == pytest.approx(expected, abs=0.03)


def test_rocking_reads_a_part_of_the_moment():
    machine = draw(2)
    slow = {'speed': 0.01, 'product_length': 0.01, 'spacing': 5.0}
    line = _line(_only(2, 'rocking'), count=1, masses=(0.2,), **slow)
    rate = line.load_cell.sample_rate
    t2, t3 = _edges(line, Eye.INFEED, False)[0], _edges(line, Eye.OUTFEED, True)[0]
    grams = grams_of(line)
    first, last = (grams[round((t2 + 2) * rate) :][:60].mean(),
                   grams[round((t3 - 2) * rate) - 60 :][:60].mean())  # fmt: skip
    # The product moves 2 (t3 - t2 - 4 s) / T of the half length in that time.
    way = 0.01 * (t3 - t2 - 4 - 60 / rate) / (machine.setup.weigh_length / 2)
    assert last - first == pytest.approx(200 * machine.rocking.coupling * way, rel=0.05)


def test_rollers_make_lines_that_grow_with_the_load_and_wander(monkeypatch):
    machine = machine_of(_only(6, 'rollers'))
    roller = replace(machine.rollers[0], amplitudes=(1e-3,), wander=0.0, growth=2.0)

    def line_of(**changes):
        profile = _with(monkeypatch, replace(machine, rollers=(replace(roller, **changes),)))
        recording = _line(
            profile, count=1, masses=(0.5,), weigh_length=10.0, spacing=21.0, lead_in=10.0,
            speed=0.5,
        )  # fmt: skip
        rate = recording.load_cell.sample_rate
        return grams_of(recording), rate, _edges(recording, Eye.INFEED, False)[0]

    def amplitude(grams, rate, begin, end):
        piece = grams[round(begin * rate) : round(end * rate)]
        time = np.arange(len(piece)) / rate
        turning = 0.5 / (np.pi * roller.diameter)
        return 2 * abs(np.mean((piece - piece.mean()) * np.exp(-2j * np.pi * turning * time)))

    grams, rate, t2 = line_of()
    ratio = (0.5 / (np.pi * roller.diameter)) / machine.platform.natural_frequency
    gain = 1 / np.hypot(1 - ratio**2, 2 * machine.platform.damping_ratio * ratio)
    empty = amplitude(grams, rate, 1, 9)
    assert empty == pytest.approx(0.5 * gain, rel=0.05)
    # 1 + 2/kg x 0.5 kg, and the platform is softer by the load.
    assert amplitude(grams, rate, t2 + 6, t2 + 14) == pytest.approx(2 * empty, rel=0.25)
    assert amplitude(*line_of(wander=3.0)[:2], 1, 9) < 0.6 * empty


def test_the_joint_comes_once_in_a_turn_of_the_belt():
    line = _line(_only(7, 'joint'), count=1, masses=(0.0,), lead_in=30.0, speed=0.5)
    grams, rate = (
        grams_of(line)[: round(29 * line.load_cell.sample_rate)],
        line.load_cell.sample_rate,
    )
    assert grams.std() > 0.01
    turn = draw(7).joint.belt_length / 0.5 * rate
    lag = np.arange(round(0.3 * turn), round(1.4 * turn))
    alike = [np.corrcoef(grams[:-k], grams[k:])[0, 1] for k in lag]
    assert lag[np.argmax(alike)] == pytest.approx(turn, abs=2)


def test_the_amplifier_takes_out_what_is_above_its_cutoff(monkeypatch):
    machine = draw(9).without('joint')
    slow = replace(draw(1).amplifier, order=2, cutoff=15.0)
    with_, without = (
        grams_of(_line(_with(monkeypatch, replace(machine, amplifier=own, noise=None))))
        for own in (slow, None)
    )
    rate = machine.setup.sample_rate
    frequency = np.fft.rfftfreq(len(with_), 1 / rate)
    # Away from the steps of the load a filter only weighs the spectrum.
    share = abs(np.fft.rfft(with_ * np.hanning(len(with_)))) / abs(
        np.fft.rfft(without * np.hanning(len(with_)))
    )
    for low, high in ((1, 3), (25, 35)):
        inside = (frequency > low) & (frequency < high)
        middle = (low + high) / 2
        expected = 1 / np.sqrt(1 + (middle / 15.0) ** 4)
        assert np.median(share[inside]) == pytest.approx(expected, rel=0.1)


def test_eyes_stand_off_their_places_and_jitter():
    machine = draw(10)
    exact, seen = (_line(_only(10, *own), count=200) for own in ((), ('eyes',)))
    for eye, place in ((Eye.INFEED, machine.eyes.infeed), (Eye.OUTFEED, machine.eyes.outfeed)):
        for blocked in (True, False):
            late = _edges(seen, eye, blocked) - _edges(exact, eye, blocked)
            assert late.mean() == pytest.approx(place / 1.0, abs=machine.eyes.jitter / 3)
            assert late.std() == pytest.approx(machine.eyes.jitter, rel=0.25)
    np.testing.assert_array_equal(counts_of(exact), counts_of(seen))
    stamps = [e.stamp for e in seen.edges if e.eye is Eye.INFEED and e.blocked]
    assert [each.stamp for each in seen.references] == stamps


def test_speed_length_and_spacing_vary():
    machine = draw(11)
    even, varied = (_line(_only(11, *own), count=300) for own in ((), ('variation',)))

    def spread(line):
        t1, t2 = _edges(line, Eye.INFEED, True), _edges(line, Eye.INFEED, False)
        t3 = _edges(line, Eye.OUTFEED, True)
        return np.std(t3 - t1) / np.mean(t3 - t1), np.std((t2 - t1) / (t3 - t1)), np.diff(t1).std()

    assert np.allclose(spread(even), 0, atol=1e-8)
    speed, length, spacing = spread(varied)
    setup, variation = machine.setup, machine.variation
    assert speed == pytest.approx(variation.speed, rel=0.25)
    part = setup.product_length / setup.weigh_length
    assert length == pytest.approx(0.88 * part * variation.length, rel=0.25)
    assert spacing == pytest.approx(0.88 * np.sqrt(2) * variation.spacing, rel=0.25)


def test_the_zero_drifts_and_the_cell_creeps(monkeypatch):
    bare = draw(12).without(*CAUSES)
    drifting = replace(draw(12).drift, rate=2e-5, wander=0.0)
    line = _line(_with(monkeypatch, replace(bare, drift=drifting)), count=1, masses=(0.0,),
                 lead_in=60.0)  # fmt: skip
    grams, rate = grams_of(line), line.load_cell.sample_rate
    slope = np.polyfit(np.arange(len(grams)) / rate, grams, 1)[0]
    assert slope == pytest.approx(0.02, rel=0.01)

    creep = replace(draw(12).creep, share=1e-2, time=3.0)
    line = _line(_with(monkeypatch, replace(bare, creep=creep)), count=1, masses=(0.2,),
                 weigh_length=10.0, speed=0.5, spacing=50.0, run_out=5.0)  # fmt: skip
    grams = grams_of(line)
    t2, t3 = _edges(line, Eye.INFEED, False)[0], _edges(line, Eye.OUTFEED, True)[0]
    assert grams[round((t3 - 0.5) * rate)] - grams[round((t2 + 3.0) * rate)] == pytest.approx(
        200 * 1e-2 * np.exp(-1.0), rel=0.1
    )
    end = line.edges[-1].stamp - START
    assert grams[round((end / 1e9 + 3.0) * rate)] == pytest.approx(2.0 * np.exp(-1), rel=0.1)


def test_the_floor_has_lines_that_drift(monkeypatch):
    bare = draw(13).without(*CAUSES)
    steady = replace(draw(13).floor, noise=0.0, lines=((9.0, 1e-4),), wander=0.0)

    def line_at_9_hz(floor):
        line = _line(_with(monkeypatch, replace(bare, floor=floor)), count=1, masses=(0.0,),
                     lead_in=120.0)  # fmt: skip
        grams, rate = grams_of(line), line.load_cell.sample_rate
        wave = np.exp(-2j * np.pi * 9.0 * np.arange(len(grams)) / rate)
        return 2 * abs(np.mean(grams * wave)), grams.std()

    line, deviation = line_at_9_hz(steady)
    assert 0.05 < line < 0.2
    drifted, same = line_at_9_hz(replace(steady, wander=10.0))
    assert drifted < 0.6 * line
    assert same == pytest.approx(deviation, rel=0.02)


def test_the_noise_is_as_drawn(monkeypatch):
    bare = draw(14).without(*CAUSES)
    noise = replace(draw(14).noise, broadband=0.0, electronic=1e-5)
    line = _line(_with(monkeypatch, replace(bare, noise=noise)), count=1, masses=(0.0,),
                 counts_per_kg=1e6, lead_in=20.0)  # fmt: skip
    assert grams_of(line).std() == pytest.approx(0.01, rel=0.03)


def test_the_family_is_broad():
    machines = [draw(seed) for seed in range(300)]
    assert {len(machine.rollers) for machine in machines} == {1, 2, 3}
    assert {machine.setup.sample_rate for machine in machines} >= {600.0, 960.0}
    assert 0.2 < sum(machine.amplifier is None for machine in machines) / 300 < 0.5
    assert all(abs(machine.eyes.infeed) <= 0.003 for machine in machines)
    steps = {1e6 / machine.setup.counts_per_kg for machine in machines}
    assert {1, 20} <= steps  # mg
    for machine in machines:
        SimulationParameters.from_mapping(asdict(machine.setup))
        assert machine.setup.weigh_length > machine.setup.product_length


@pytest.mark.parametrize(
    ('profile', 'message'),
    [
        ('machine:', "the seed '' of the machine is not a whole number"),
        ('machine:x', "the seed 'x' of the machine is not a whole number"),
        ('machine:3-luck', "'luck' is not one of rocking, corner, transfer, bounce, rollers"),
        ('engine:3', "'engine:3' is not one of paper, .*quiet or machine:SEED"),
    ],
)
def test_what_is_no_machine_is_refused(profile, message):
    with pytest.raises(ParameterError, match=f'simulator.profile: .*{message}'):
        SimulationParameters(profile=profile)


def test_causes_are_the_fields_that_may_be_none():
    may_be_none = tuple(field.name for field in fields(Machine) if 'None' in str(field.type))
    assert may_be_none == CAUSES
    assert machine_of('paper') is None
