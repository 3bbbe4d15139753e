# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings of the gateways: one file with a section for each."""

from dataclasses import dataclass
from pathlib import Path

from checkweigher_core.parameters import parameter
from checkweigher_core.settings_files import Settings, read_settings
from checkweigher_gateways import KINDS

_ADDRESS = '127.0.0.1'


@dataclass(frozen=True)
class MetricsSettings(Settings):
    """Section of the gateway for Prometheus."""

    host: str = parameter(_ADDRESS, 'address that is served')
    port: int = parameter(9464, 'port; 0 for a free one', minimum=0, maximum=65535)
    certificate: str = parameter('', 'certificate for TLS, PEM; empty for no TLS')
    key: str = parameter('', 'its key, PEM')
    clients: str = parameter('', 'certificates of the clients, or of who signs them, PEM')


@dataclass(frozen=True)
class GatewaySettings(Settings):
    """Settings of all gateways. A file runs the gateways whose sections it has."""

    metrics: MetricsSettings | None = parameter(None, 'Prometheus')

    @property
    def kinds(self) -> list[str]:
        """Names of the sections that the file has."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]


def read_gateways(path: Path | None) -> GatewaySettings:
    """Return the settings of a file, the defaults without one; SettingsError if it is invalid."""
    return GatewaySettings() if path is None else read_settings(path, GatewaySettings)
