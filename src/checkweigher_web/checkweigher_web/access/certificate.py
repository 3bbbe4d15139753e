# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Creation of a self-signed certificate for the page, and check of a certificate."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
import os
from pathlib import Path
import ssl

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from checkweigher_core.whole_file import check_new, write_whole

_VALID = timedelta(days=825)  # validity of a new certificate: the maximum that Safari accepts


class CertificateError(ValueError):
    """Raised if a certificate, its key, or a name for a new certificate cannot be used.

    The message is one line.
    """


def make_certificate(names: Sequence[str], certificate: Path, key: Path) -> str:
    """Write a self-signed certificate for host names and addresses, and its private key.

    Returns the SHA-256 fingerprint, which a user compares with the one in the browser. Raises
    `CertificateError` for an invalid name, and `OutputError` if a file already exists or cannot be
    written.
    """
    for path in (certificate, key):
        check_new(path)
    try:
        alternatives = x509.SubjectAlternativeName([_name(name) for name in names])
    except ValueError as error:
        raise CertificateError(f'{", ".join(names)}: {error}') from None
    secret, now = ec.generate_private_key(ec.SECP256R1()), datetime.now(UTC)
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, names[0][:64])])
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(secret.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))  # valid for browsers with a slow clock
        .not_valid_after(now + _VALID)
        .add_extension(alternatives, critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(secret, hashes.SHA256())
    )
    private = secret.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    write_whole(key, private.decode('ascii'), mode=0o600)
    write_whole(certificate, made.public_bytes(Encoding.PEM).decode('ascii'))
    return made.fingerprint(hashes.SHA256()).hex(':').upper()


def _name(text: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(text))
    except ValueError:
        return x509.DNSName(text)


def check_pair(certificate: Path, key: Path) -> None:
    """Check that a server can use a certificate and its private key.

    Raises `CertificateError` if a file cannot be read, if the permissions of the key let other
    users access the key, or if the files are not in PEM format, are protected by a password, or do
    not belong together.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    for path in (certificate, key):
        try:
            with path.open('rb') as file:
                status = os.stat(file.fileno())
        except OSError as error:
            raise CertificateError(f'{path}: {error.strerror or error}') from None
    # A key that root owns may be readable by its group, such as ssl-cert on Debian, because a page
    # that does not run as root could not read it otherwise.
    mode = 0o640 if status.st_uid == 0 != os.geteuid() else 0o600
    if status.st_mode & 0o777 & ~mode:
        raise CertificateError(
            f'{key}: other users of this machine may use it; run: chmod {mode:o} {key}'
        )
    try:
        context.load_cert_chain(certificate, key, password=lambda: '')
    except (OSError, ValueError) as error:
        reason = getattr(error, 'reason', None) or error
        raise CertificateError(
            f'{certificate} and {key}: must be a certificate and its key, in PEM and '
            f'without a password: {reason}'
        ) from None
