# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Metrics of the lanes for Prometheus."""

import math
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, start_http_server

from checkweigher_core.health.findings import Level
from checkweigher_core.records import (
    GRAMS,
    Alarms,
    ProductOnLine,
    StopRequest,
    Verdict,
    seconds,
)
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros.ports import DIAGNOSTICS, NODES, STOP_REQUEST
from checkweigher_core.ros.services import GATEWAYS, OF_MACHINE, REPORTER
from checkweigher_gateways.gateway import Gateway, GatewayError
from checkweigher_gateways.listening import Taken
from checkweigher_gateways.settings import GatewaySettings, MetricsSettings
from checkweigher_web.access.certificate import check_pair

# Bounds of the masses in g: ten in each decade, rounded as the series R10 of ISO 3.
_R10 = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)
MASSES = [float(f'{step}e{decade}') for decade in (1, 2, 3, 4) for step in _R10]
# Bounds of the deviation from the nominal mass, as a share of it.
DEVIATIONS = [
    sign * each / 1000
    for sign, sizes in ((-1, (100, 50, 30, 20, 15, 10, 5, 2)), (1, (0, 2, 5, 10, 20, 30, 50, 100)))
    for each in sizes
]
_UNKNOWN = 'Unknown'  # reason of another version, so that no text of a message becomes a label
# Figures of the diagnostics by node, aspect and key: name, help and factor to the unit of the name.
_FIGURES = {
    ('segmenter', 'Zero', 'from_calibration_g'): (
        'checkweigher_zero_offset_grams', 'Zero of the belt, from that of the calibration.', 1.0),
    ('segmenter', 'Belt noise', 'std_dev_g'): (
        'checkweigher_belt_noise_grams', 'Standard deviation of the empty belt.', 1.0),
    ('reject', 'Verdicts', 'latency_median_ms'): (
        'checkweigher_verdict_latency_median_seconds',
        'From the outfeed edge to the verdict, median of the last minute.', 1e-3),
    ('reject', 'Verdicts', 'latency_max_ms'): (
        'checkweigher_verdict_latency_max_seconds',
        'From the outfeed edge to the verdict, largest of the last minute.', 1e-3),
    ('reject', 'Verdicts', 'least_margin_ms'): (
        'checkweigher_verdict_margin_min_seconds',
        'From the verdict to its reject time, least of the last minute.', 1e-3),
}  # fmt: skip
# Processes beside the lines, which run where a node of theirs is in the graph.
_BESIDE = ('page', REPORTER, *GATEWAYS)
# Nodes whose diagnostics are shown; others may publish on the topic as well.
_REPORTING = {*NODES, *OF_MACHINE, *GATEWAYS}


class Metrics(Gateway):
    """Gateway with a page of metrics, which Prometheus reads.

    All counts are of the verdicts since the start of the gateway. A lane without a namespace has
    the label ``lane=""``. Numbers and names of items and batches are no labels.

    Attributes
    ----------
    registry : CollectorRegistry
        The metrics.
    """

    def __init__(self, settings: MetricsSettings) -> None:
        self._settings = settings
        self._products: dict[str, ProductOnLine] = {}
        self._stops: dict[str, StopRequest] = {}
        self._server: Any = None
        self.registry = registry = CollectorRegistry()

        def counter(name: str, text: str, *labels: str) -> Counter:
            return Counter(f'checkweigher_{name}', text, labels, registry=registry)

        def gauge(name: str, text: str, *labels: str) -> Gauge:
            return Gauge(f'checkweigher_{name}', text, labels, registry=registry)

        def histogram(name: str, text: str, bounds: list[float]) -> Histogram:
            return Histogram(
                f'checkweigher_{name}', text, ['lane'], buckets=bounds, registry=registry
            )

        self._items = counter('items', 'Items, by decision.', 'lane', 'decision')
        self._reasons = counter('item_reasons', 'Items, by each reason.', 'lane', 'reason')
        self._late = counter('late_verdicts', 'Verdicts after their reject time.', 'lane')
        self._masses = histogram('item_mass_grams', 'Masses as weighed.', MASSES)
        self._deviations = histogram(
            'item_deviation_ratio', 'Mass minus nominal, as a share of nominal.', DEVIATIONS
        )
        self._last = gauge('last_item_timestamp_seconds', 'Stamp t3 of the last item.', 'lane')
        self._stop = gauge('stop_requested', '1 while the line is asked to stop.', 'lane')
        self._stop_requests = counter('stop_requests', 'Stop requests.', 'lane', 'reason')
        self._alarms = gauge('alarms', 'Alarms that last or are not acknowledged.', 'lane')
        self._product = gauge('product_info', 'The product on the line.', 'lane', 'product')
        self._level = gauge(
            'diagnostic_level', '0 OK, 1 WARN, 2 ERROR, 3 STALE.', 'lane', 'node', 'aspect'
        )
        self._reported = gauge(
            'node_last_report_timestamp_seconds', 'Stamp of the last diagnostics.', 'lane', 'node'
        )
        self._running = gauge('process_running', '1 while a node of it is there.', 'process')
        self._dropped = counter('gateway_records_dropped', 'Records that this gateway lost.')
        self._lost = 0
        self._figures = {
            key: (Gauge(name, text, ['lane'], registry=registry), factor)
            for key, (name, text, factor) in _FIGURES.items()
        }

    async def start(self) -> str:
        """Serve the page of metrics in a thread of its own."""
        its, tls = self._settings, bool(self._settings.certificate)
        if tls:
            check_pair(Path(its.certificate), Path(its.key))
        try:
            self._server, _ = start_http_server(
                its.port,
                its.host,
                self.registry,
                certfile=its.certificate or None,
                keyfile=its.key or None,
                client_cafile=its.clients or None,
                client_auth_required=bool(its.clients),
            )
        except OSError as error:
            raise GatewayError(f'metrics: {its.host}:{its.port}: {error}') from None
        return f'http{"s" * tls}://{its.host}:{self._server.server_port}/metrics'

    async def take(self, taken: Taken) -> None:
        """Count a record."""
        lane, record = taken.lane, taken.record
        match record:
            case Verdict():
                self._count(lane, record)
            case Alarms():
                self._alarms.labels(lane).set(len(record.alarms))
            case ProductOnLine():
                if lane in self._products:
                    self._product.remove(lane, self._products[lane].product)
                self._products[lane] = record
                self._product.labels(lane, record.product).set(1)
            case StopRequest():
                if self._stops.get(lane) != record:
                    self._stop_requests.labels(lane, record.reason).inc()
                self._stops[lane] = record
                self._stop.labels(lane).set(1)
            case None if taken.port is STOP_REQUEST:
                self._stops.pop(lane, None)
                self._stop.labels(lane).set(0)
            case _ if taken.port is DIAGNOSTICS:
                self._note(record)

    def _count(self, lane: str, verdict: Verdict) -> None:
        self._items.labels(lane, verdict.decision.name.lower()).inc()
        for reason in verdict.reasons:
            known = reason in Reason.__members__.values()
            self._reasons.labels(lane, reason if known else _UNKNOWN).inc()
        self._late.labels(lane).inc(verdict.late)
        if verdict.t3 is not None:
            self._last.labels(lane).set(seconds(verdict.t3))
        if math.isfinite(verdict.mass):
            self._masses.labels(lane).observe(GRAMS * verdict.mass)
            product = self._products.get(lane)
            if product is not None and product.nominal > 0:
                self._deviations.labels(lane).observe(verdict.mass / product.nominal - 1)

    def _note(self, message: Any) -> None:
        """Show the levels and figures of diagnostics."""
        stamp = message.header.stamp
        for status in message.status:
            path, _, aspect = status.name.partition(': ')
            lane, _, node = path.strip('/').rpartition('/')
            if node not in _REPORTING:
                continue
            self._level.labels(lane, node, aspect).set(min(status.level[0], Level.STALE))
            self._reported.labels(lane, node).set(stamp.sec + 1e-9 * stamp.nanosec)
            for value in status.values:
                if (figure := self._figures.get((node, aspect, value.key))) is not None:
                    gauge, factor = figure
                    gauge.labels(lane).set(factor * float(value.value))

    async def turn(self) -> None:
        """Show which processes run, and the number of records that were lost."""
        for name in _BESIDE:
            self._running.labels(name).set(name in self.intake.nodes)
        lost = self.intake.dropped
        self._dropped.inc(lost - self._lost)
        self._lost = lost

    async def close(self) -> None:
        """End the server."""
        self._server.shutdown()


def make(settings: GatewaySettings) -> Gateway:
    """Return the gateway."""
    return Metrics(settings.metrics or MetricsSettings())
