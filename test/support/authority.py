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

    def pair(self, name: str, uri: str = 'urn:plant') -> Pair:
        """Return a certificate for a server on this computer or for a client of that name."""
        return self._write(name, rsa.generate_private_key(65537, 2048), uri)

    def _write(self, name: str, key: rsa.RSAPrivateKey | None, uri: str = 'urn:plant') -> Pair:
        own, now = key or self._key, datetime.now(UTC)
        usages = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        here = [
            x509.UniformResourceIdentifier(uri),
            x509.DNSName('localhost'),
            x509.IPAddress(ip_address('127.0.0.1')),
        ]
        subject = x509.SubjectKeyIdentifier.from_public_key(own.public_key())
        issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key())
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
            .add_extension(_key_usage(signs=key is None), critical=True)
            # Python 3.13 and later demand both identifiers (RFC 5280, 4.2.1.1 and 4.2.1.2).
            .add_extension(subject, critical=False)
            .add_extension(issuer, critical=False)
            .sign(self._key, hashes.SHA256())
        )
        files = Pair(self._folder / f'{name}.pem', self._folder / f'{name}.key.pem')
        secret = own.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
        files.key.write_bytes(secret)
        files.key.chmod(0o600)
        files.certificate.write_bytes(made.public_bytes(Encoding.PEM))
        return files


def _key_usage(signs: bool) -> x509.KeyUsage:
    """Return the usages of the key of an authority, or of a server or client of OPC UA or MQTT."""
    return x509.KeyUsage(
        digital_signature=True,
        content_commitment=True,
        key_encipherment=True,
        data_encipherment=True,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )
