# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A certificate authority of a plant, for servers and their clients."""

from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID


class Pair(NamedTuple):
    """Files of a certificate and of its key, PEM."""

    certificate: Path
    key: Path


class Authority:
    """An authority with its certificate in the file `certificate`."""

    def __init__(self, folder: Path, name: str = 'plant') -> None:
        self._folder = folder
        self._name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        self._key = rsa.generate_private_key(65537, 2048)
        self.certificate = self._write(name, None).certificate

    def pair(self, name: str) -> Pair:
        """Return a certificate for a server on this computer or for a client of that name."""
        return self._write(name, rsa.generate_private_key(65537, 2048))

    def _write(self, name: str, key: rsa.RSAPrivateKey | None) -> Pair:
        own, now = key or self._key, datetime.now(UTC)
        usages = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        here = [x509.DNSName('localhost'), x509.IPAddress(ip_address('127.0.0.1'))]
        made = (
            x509.CertificateBuilder()
            .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
            .issuer_name(self._name)
            .public_key(own.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - timedelta(hours=1))
            .not_valid_after(now + timedelta(days=1))
            .add_extension(x509.SubjectAlternativeName(here), critical=False)
            .add_extension(x509.BasicConstraints(ca=key is None, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        files = Pair(self._folder / f'{name}.pem', self._folder / f'{name}.key')
        secret = own.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        files.key.write_bytes(secret)
        files.key.chmod(0o600)
        files.certificate.write_bytes(made.public_bytes(Encoding.PEM))
        return files
