# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings of the gateways, in a file with one section for each gateway."""

from dataclasses import dataclass
from pathlib import Path

from checkweigher_core.parameters import parameter
from checkweigher_core.settings_files import Settings, read_settings
from checkweigher_gateways import KINDS

_ADDRESS = '127.0.0.1'


@dataclass(frozen=True)
class MetricsSettings(Settings):
    """Settings of the metrics gateway."""

    host: str = parameter(_ADDRESS, 'address at which the server listens')
    port: int = parameter(9464, 'port; 0 selects a free port', minimum=0, maximum=65535)
    certificate: str = parameter('', 'PEM file of the server certificate; empty without TLS')
    key: str = parameter('', 'PEM file of the private key')
    clients: str = parameter(
        '', 'PEM file with the trusted certificates of clients; empty accepts any client'
    )


@dataclass(frozen=True)
class MqttSettings(Settings):
    """Settings of the MQTT gateway."""

    host: str = parameter(_ADDRESS, 'address of the broker')
    port: int = parameter(1883, 'broker port; usually 8883 with TLS', minimum=1, maximum=65535)
    user: str = parameter('', 'user name at the broker; empty without login')
    password_file: str = parameter('', 'file with the password of the user')
    authority: str = parameter('', 'PEM file with the authority of the broker; enables TLS')
    certificate: str = parameter('', 'PEM file of the certificate of this gateway')
    key: str = parameter('', 'PEM file of the private key')
    prefix: str = parameter('checkweigher', 'first level of the JSON topics')
    node: str = parameter('', 'name of this computer; empty selects its host name')
    site: str = parameter('', 'Sparkplug B group; empty to publish only JSON')
    commands: bool = parameter(False, 'whether hosts may select products, begin batches and zero')
    store: str = parameter('', 'file of waiting items; empty selects one in the state folder')
    limit: int = parameter(
        1_000_000, 'largest number of waiting items; beyond it, the oldest is dropped', minimum=1
    )


@dataclass(frozen=True)
class OpcuaSettings(Settings):
    """Settings of the OPC UA gateway."""

    host: str = parameter(_ADDRESS, 'address at which the server listens')
    port: int = parameter(4840, 'port; 0 selects a free port', minimum=0, maximum=65535)
    certificate: str = parameter(
        '', 'PEM file of the certificate; required unless host is a loopback address'
    )
    key: str = parameter('', 'PEM file of the private key')
    clients: str = parameter('', 'folder with the trusted certificates of clients or authorities')
    users: str = parameter('', 'users file; empty selects the file of the command user')
    nodesets: str = parameter('', 'folder of the models; empty selects that of setup/nodesets')


@dataclass(frozen=True)
class GatewaySettings(Settings):
    """Settings of all gateways. The line runs the gateways whose sections are in the file."""

    metrics: MetricsSettings | None = parameter(None, 'gateway for Prometheus')
    mqtt: MqttSettings | None = parameter(None, 'gateway for MQTT and Sparkplug B')
    opcua: OpcuaSettings | None = parameter(None, 'gateway for OPC UA')

    @property
    def kinds(self) -> list[str]:
        """Kinds of the gateways whose sections are in the file."""
        return [kind for kind in KINDS if getattr(self, kind) is not None]


def read_gateways(path: Path | None) -> GatewaySettings:
    """Return the settings in a file, or the default settings if `path` is None.

    Raises `SettingsError` if the file cannot be read or a setting is not valid.
    """
    return GatewaySettings() if path is None else read_settings(path, GatewaySettings)
