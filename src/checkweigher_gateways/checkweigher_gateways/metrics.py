# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Metrics of the lanes for Prometheus."""

import math
from pathlib import Path
from typing import Any

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, start_http_server

from checkweigher_core.health.findings import Level
from checkweigher_core.records import GRAMS, Alarms, ProductOnLine, StopRequest, Verdict, seconds
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros.ports import DIAGNOSTICS, NODES, STOP_REQUEST
from checkweigher_core.ros.services import GATEWAYS, OF_MACHINE, REPORTER
from checkweigher_core.ros.status_board import number_of
from checkweigher_gateways.gateway import Gateway, GatewayError
from checkweigher_gateways.listening import Taken
from checkweigher_gateways.settings import GatewaySettings, MetricsSettings
from checkweigher_web.access.certificate import check_pair

_R10 = (1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0)  # series R10 of ISO 3.
# Bounds of the mass histogram in g.
MASSES = [float(f'{step}e{decade}') for decade in (1, 2, 3, 4) for step in _R10]
# Bounds of the deviation histogram, as fractions of the nominal mass.
DEVIATIONS = [
    sign * each / 1000
    for sign, sizes in ((-1, (100, 50, 30, 20, 15, 10, 5, 2)), (1, (0, 2, 5, 10, 20, 30, 50, 100)))
    for each in sizes
]
# Label of all reasons that are not in `Reason`. Prometheus stores a time series for each label, so
# the number of labels must not depend on the messages.
_UNKNOWN = 'Unknown'
# Metrics of values in the diagnostics, by the node, the aspect and the key of the value. An entry
# contains the name and the help text of the metric, and the factor that converts the value to the
# unit of the metric.
_FIGURES = {
    ('segmenter', 'Zero', 'from_calibration_g'): (
        'checkweigher_zero_offset_grams', 'Zero of the belt relative to the calibration.', 1.0),
    ('segmenter', 'Belt noise', 'std_dev_g'): (
        'checkweigher_belt_noise_grams', 'Standard deviation of the empty-belt signal.', 1.0),
    ('reject', 'Verdicts', 'latency_median_ms'): (
        'checkweigher_verdict_latency_median_seconds',
        'Median time from outfeed edge to verdict in the last minute.', 1e-3),
    ('reject', 'Verdicts', 'latency_max_ms'): (
        'checkweigher_verdict_latency_max_seconds',
        'Longest time from outfeed edge to verdict in the last minute.', 1e-3),
    ('reject', 'Verdicts', 'least_margin_ms'): (
        'checkweigher_verdict_margin_min_seconds',
        'Shortest time from verdict to reject time in the last minute.', 1e-3),
}  # fmt: skip
# Processes outside the lines. A process counts as running if its node is in the ROS graph.
_BESIDE = ('page', REPORTER, *GATEWAYS)
# Nodes whose diagnostics are exported. The diagnostics of other nodes are ignored, because any node
# of the ROS graph may publish diagnostics.
_REPORTING = {*NODES, *OF_MACHINE, *GATEWAYS}


class Metrics(Gateway):
    """Gateway that serves metrics to Prometheus.

    Counters begin at 0 when the gateway starts. A lane without a namespace has the label
    ``lane=""``. Item numbers and batch names are not labels, because Prometheus stores a separate
    time series for each value of a label.

    Attributes
    ----------
    registry : CollectorRegistry
        Registry of the metrics.
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

        self._items = counter('items', 'Number of items by decision.', 'lane', 'decision')
        self._reasons = counter('item_reasons', 'Number of items by reason.', 'lane', 'reason')
        self._late = counter('late_verdicts', 'Number of late verdicts.', 'lane')
        self._masses = histogram('item_mass_grams', 'Masses of the items.', MASSES)
        self._deviations = histogram(
            'item_deviation_ratio', 'Relative deviation from the nominal mass.', DEVIATIONS
        )
        self._last = gauge('last_item_timestamp_seconds', 'Time t3 of the last item.', 'lane')
        self._stop = gauge('stop_requested', '1 while a stop is requested.', 'lane')
        self._stop_requests = counter('stop_requests', 'Number of stop requests.', 'lane', 'reason')
        self._alarms = gauge('alarms', 'Number of active or unacknowledged alarms.', 'lane')
        self._product = gauge('product_info', 'Product on the line.', 'lane', 'product')
        self._level = gauge(
            'diagnostic_level', 'Level: 0 OK, 1 WARN, 2 ERROR, 3 STALE.', 'lane', 'node', 'aspect'
        )
        self._reported = gauge(
            'node_last_report_timestamp_seconds', 'Time of the last diagnostics.', 'lane', 'node'
        )
        self._running = gauge('process_running', '1 while the process runs.', 'process')
        self._dropped = counter('gateway_records_dropped', 'Number of dropped records.')
        self._lost = 0
        self._figures = {
            key: (Gauge(name, text, ['lane'], registry=registry), factor)
            for key, (name, text, factor) in _FIGURES.items()
        }

    async def start(self) -> str:
        """Start the HTTP server in its own thread, and return the URL of the metrics.

        Raises `CertificateError` if the certificate or its key cannot be used, and `GatewayError`
        if the server cannot listen at the address or read the file of the client certificates.
        """
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
        """Update the metrics with a record of a lane, or with diagnostics.

        A record that no metric describes is ignored.
        """
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
        """Update the level, the report time and the figures of each node in a diagnostics message.

        Nodes that are not in `_REPORTING` are ignored.
        """
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
                    gauge.labels(lane).set(factor * number_of(value.value))

    async def turn(self) -> None:
        """Update the states of the processes, and the number of dropped records."""
        for name in _BESIDE:
            self._running.labels(name).set(name in self.intake.nodes)
        lost = self.intake.dropped
        self._dropped.inc(lost - self._lost)
        self._lost = lost

    async def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()


def make(settings: GatewaySettings) -> Gateway:
    """Return the metrics gateway."""
    return Metrics(settings.metrics or MetricsSettings())
