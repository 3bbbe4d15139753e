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
class MqttSettings(Settings):
    """Section of the gateway for MQTT."""

    host: str = parameter(_ADDRESS, 'address of the broker')
    port: int = parameter(1883, 'its port; 8883 is usual for TLS', minimum=1, maximum=65535)
    user: str = parameter('', 'user at the broker; empty for none')
    password_file: str = parameter('', 'file with the password of the user')
    authority: str = parameter('', 'certificate of the authority of the broker, PEM, for TLS')
    certificate: str = parameter('', 'certificate of this client, PEM')
    key: str = parameter('', 'its key, PEM')
    prefix: str = parameter('checkweigher', 'first element of the topics with JSON')
    node: str = parameter('', 'name of this computer; empty for its host name')
    site: str = parameter('', 'group of Sparkplug B; empty for JSON only')
    commands: bool = parameter(False, 'whether the broker may select products and batches and zero')
    store: str = parameter('', 'file of the items that wait; empty for one in the state folder')
    limit: int = parameter(1_000_000, 'largest number of items that wait', minimum=1)


@dataclass(frozen=True)
class GatewaySettings(Settings):
    """Settings of all gateways. A file runs the gateways whose sections it has."""

    metrics: MetricsSettings | None = parameter(None, 'Prometheus')
    mqtt: MqttSettings | None = parameter(None, 'MQTT, with Sparkplug B')

    @property
    def kinds(self) -> list[str]:
        """Names of the sections that the file has."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]


def read_gateways(path: Path | None) -> GatewaySettings:
    """Return the settings of a file, the defaults without one; SettingsError if it is invalid."""
    return GatewaySettings() if path is None else read_settings(path, GatewaySettings)
