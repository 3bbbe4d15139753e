# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The metrics of a line that runs, as Prometheus reads them."""

import asyncio
from collections import Counter
from contextlib import suppress
import json
import math
import os
from pathlib import Path
import re
import shutil
import signal
import ssl
import subprocess
from urllib.error import URLError
from urllib.request import urlopen

from authority import Authority
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from gateway_process import LANE, Verdicts, gateway
from prometheus_client import Metric
from prometheus_client.parser import text_string_to_metric_families
import pytest
from running import ROOT, free_port, wait_for
import yaml

from checkweigher_core.records import GRAMS, Verdict, seconds
from checkweigher_gateways.metrics import Metrics, make
from checkweigher_gateways.settings import MetricsSettings, read_gateways

PORT = free_port()
ADDRESS = f'http://127.0.0.1:{PORT}/metrics'
GATEWAYS = {'metrics': {'port': PORT}}
CONFIG = ROOT / 'src/checkweigher_gateways/config'
PROMTOOL = shutil.which('promtool')
needs_promtool = pytest.mark.skipif(PROMTOOL is None, reason="Debian's prometheus is not installed")


class Scrape:
    """What Prometheus reads at one time."""

    def __init__(self) -> None:
        with urlopen(ADDRESS, timeout=1.0) as answer:
            self.page = answer.read().decode()
        families = text_string_to_metric_families(self.page)
        self.samples = [each for family in families for each in family.samples]

    def counts(self, name: str, label: str) -> Counter[str]:
        """Return a counter of the lane by a label."""
        return Counter(
            {
                each.labels[label]: int(each.value)
                for each in self.samples
                if each.name == f'checkweigher_{name}_total' and each.labels.get('lane') == LANE
            }
        )

    def value(self, name: str, **labels: str) -> float:
        """Return a value with these labels, NaN if there is none."""
        found = (e for e in self.samples if (e.name, e.labels) == (f'checkweigher_{name}', labels))
        return next((each.value for each in found), math.nan)

    def of_lane(self, name: str) -> float:
        """Return a value of the lane, NaN if there is none."""
        return self.value(name, lane=LANE)

    def place_in(self, verdicts: list[Verdict]) -> int:
        """Return how many of the verdicts had come."""
        last = self.of_lane('last_item_timestamp_seconds')
        found = [n for n, each in enumerate(verdicts, 1) if seconds(each.t3) == last]
        return found[0] if found else 0


def seen() -> float:
    """Return the number of items that a gateway has counted, 0 without one."""
    with suppress(OSError):
        return float(Scrape().counts('items', 'decision').total())
    return 0.0


def placed(verdicts: Verdicts, least: int) -> tuple[Scrape, int] | None:
    """Return what is read and how many verdicts it counts, None if those are less or unknown."""
    read = Scrape()
    place = read.place_in(verdicts.taken)
    return (read, place) if place >= least else None


def test_the_metrics_are_those_of_the_verdicts(verdicts: Verdicts):
    wait_for(lambda: seen() > 0, 'an item')
    before, begin = wait_for(lambda: placed(verdicts, 1))
    after, end = wait_for(lambda: placed(verdicts, begin + 5))
    taken = verdicts.taken[begin:end]
    assert after.counts('items', 'decision') - before.counts('items', 'decision') == Counter(
        each.decision.name.lower() for each in taken
    )
    assert after.counts('item_reasons', 'reason') - before.counts(
        'item_reasons', 'reason'
    ) == Counter(reason for each in taken for reason in each.reasons)
    masses = [each.mass for each in taken if math.isfinite(each.mass)]
    gained = {
        part: after.of_lane(f'item_mass_grams_{part}') - before.of_lane(f'item_mass_grams_{part}')
        for part in ('count', 'sum')
    }
    assert gained == {'count': len(masses), 'sum': pytest.approx(GRAMS * sum(masses))}
    for name in ('zero_offset_grams', 'belt_noise_grams'):
        wait_for(lambda name=name: math.isfinite(Scrape().of_lane(name)), name)
    wait_for(lambda: 0 < Scrape().of_lane('verdict_latency_median_seconds') < 1)
    assert after.value('process_running', process='gateway_metrics') == 1
    assert after.value('process_running', process='page') == 0
    check_metrics(after.page)
    # A gateway that hangs is killed, and one that was killed is started again.
    os.kill(verdicts.gateway(), signal.SIGSTOP)
    verdicts.go_on()
    wait_for(lambda: seen() > 0, 'a gateway again')
    os.kill(verdicts.gateway(), signal.SIGKILL)
    verdicts.go_on()
    wait_for(lambda: seen() > 0, 'a gateway again')


def test_text_in_place_of_a_number_does_not_end_the_gateway(verdicts: Verdicts):
    wait_for(lambda: seen() > 0, 'an item')
    process = verdicts.gateway()
    publisher = verdicts.create_publisher(DiagnosticArray, '/diagnostics', 10)
    message = DiagnosticArray(
        status=[
            DiagnosticStatus(
                name=f'stranger/segmenter: {aspect}', values=[KeyValue(key=key, value=v)]
            )
            for aspect, key, v in (
                ('Zero', 'from_calibration_g', 'unknown'),
                ('Belt noise', 'std_dev_g', '0.5'),
            )
        ]
    )

    def noise() -> float:
        publisher.publish(message)
        return Scrape().value('belt_noise_grams', lane='stranger')

    wait_for(lambda: noise() == 0.5)
    assert math.isnan(Scrape().value('zero_offset_grams', lane='stranger'))
    assert verdicts.gateway() == process


def check_metrics(page: str) -> None:
    """Check the page by the linter of Prometheus, where that is installed."""
    if PROMTOOL is not None:
        done = subprocess.run(
            [PROMTOOL, 'check', 'metrics'], input=page, capture_output=True, text=True
        )
        assert (done.returncode, done.stdout + done.stderr) == (0, '')


def names() -> set[str]:
    """Return the names of all samples that the gateway may have."""
    made = Metrics(MetricsSettings())
    return {name for family in made.registry.collect() for name in _samples_of(family)}


def _samples_of(family: Metric) -> list[str]:
    endings = {'counter': ['_total'], 'histogram': ['_bucket', '_sum', '_count']}
    return [family.name + ending for ending in endings.get(family.type, [''])]


def expressions() -> list[str]:
    """Return the queries of the dashboard and of the rules."""
    board = json.loads((CONFIG / 'grafana_dashboard.json').read_text())
    rules = yaml.safe_load((CONFIG / 'prometheus_rules.yaml').read_text())
    return [
        *(target['expr'] for panel in board['panels'] for target in panel['targets']),
        *(rule['expr'] for group in rules['groups'] for rule in group['rules']),
    ]


def test_dashboard_and_rules_ask_for_metrics_that_there_are():
    asked = {name for each in expressions() for name in re.findall(r'checkweigher_\w+', each)}
    assert len(asked) > 10
    assert asked <= names()


@needs_promtool
def test_the_rules_are_valid_and_fire():
    for words in (
        ['check', 'rules', 'prometheus_rules.yaml'],
        ['test', 'rules', 'prometheus_rules_test.yaml'],
    ):
        done = subprocess.run([PROMTOOL, *words], cwd=CONFIG, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


def test_a_page_over_tls_asks_for_a_certificate(tmp_path: Path):
    plant = Authority(tmp_path)
    own, client = plant.pair('gateway'), plant.pair('prometheus')
    settings = {
        'port': 0,
        'certificate': str(own.certificate),
        'key': str(own.key),
        'clients': str(plant.certificate),
    }
    with gateway('metrics', tmp_path, settings) as (_, address):
        assert address.startswith('https://')
        context = ssl.create_default_context(cafile=plant.certificate)
        with pytest.raises((URLError, ssl.SSLError)):
            urlopen(address, context=context).read()
        context.load_cert_chain(client.certificate, client.key)
        assert b'checkweigher_' in urlopen(address, context=context).read()


def test_settings_that_cannot_be_used_are_one_line(tmp_path: Path):
    file = tmp_path / 'gateways.yaml'
    for text, why in (
        ('metrics: {prot: 1}', 'metrics.prot: no such key'),
        ('metrics: {host: 192.0.2.1}', '192.0.2.1'),
        ('metrics: {certificate: /none, port: 0}', '/none'),
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=why) as error:
            asyncio.run(make(read_gateways(file)).start())
        assert '\n' not in str(error.value)
