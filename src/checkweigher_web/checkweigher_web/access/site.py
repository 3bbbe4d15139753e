# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The site: where the page is served, to whom, and what that takes."""

from dataclasses import dataclass, replace
from ipaddress import ip_address
from pathlib import Path
from socket import gethostname
from urllib.parse import urlsplit

from checkweigher_web import ADDRESS, PORT
from checkweigher_web.access.certificate import check_pair
from checkweigher_web.access.users import default_users, read_users


class PageError(ValueError):
    """A page that cannot be served; one line that says why and what to do."""


@dataclass(frozen=True)
class Site:
    """Address and port, certificate and key, users, and the address that a reverse proxy gives."""

    host: str = ADDRESS
    port: int = PORT
    certificate: Path | None = None
    key: Path | None = None
    users: Path | None = None
    origin: str = ''  # https://NAME of a reverse proxy, empty without one
    idle: float = 30.0  # min without a click, a key or a page, after which a session ends

    @property
    def loopback(self) -> bool:
        """Whether it is served to this machine alone."""
        return self.host == 'localhost' or _is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether anyone at this machine may view it without a login."""
        return self.loopback and not self.origin

    @property
    def secure(self) -> bool:
        """Whether browsers reach it by TLS."""
        return self.certificate is not None or bool(self.origin)

    @property
    def address(self) -> str:
        """Address by which the page may be opened, and that of the proxy."""
        host = gethostname() if self.host in ('0.0.0.0', '::') else self.host
        host = f'[{host}]' if ':' in host else host
        scheme = 'http' if self.certificate is None else 'https'
        proxy = f', as {self.origin}/' if self.origin else ''
        return f'{scheme}://{host}:{self.port}/{proxy}'

    def serves(self, host: str) -> bool:
        """Tell whether a browser may ask for it by a host, with port.

        A site elsewhere can have a name of its own point to this machine. By TLS its browser does
        not find that name in the certificate.
        """
        if self.origin:
            return host.lower() == urlsplit(self.origin).netloc
        # The port may be another one: that of a tunnel.
        return not self.loopback or host.rpartition(':')[0].strip('[]') in (self.host, 'localhost')

    def checked(self) -> 'Site':
        """Return the site with the users that there are, or raise what keeps it from being served.

        `PageError`, `CertificateError` or `SettingsError`.
        """
        if (self.certificate is None) != (self.key is None):
            raise PageError('--certificate and --key: one needs the other')
        if not self.idle > 0:
            raise PageError(f'--idle {self.idle:g}: must be above 0')
        users = self.users or default_users()
        known = read_users(users) if users == self.users or users.exists() else {}
        if not self.loopback and (self.certificate is None or not known):
            raise PageError(
                f'--host {self.host}: needs --certificate and --key, which checkweigher '
                'certificate makes, and a user: checkweigher user add NAME --role R'
            )
        if self.origin and not known:
            raise PageError('--origin: needs a user: checkweigher user add NAME --role R')
        if self.certificate is not None and self.key is not None:
            check_pair(self.certificate, self.key)
        return replace(self, users=users, origin=_origin(self.origin))


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _origin(given: str) -> str:
    """Return an origin as browsers write it."""
    if not given:
        return ''
    parts = urlsplit(given.lower())
    if parts.scheme != 'https' or not parts.netloc or parts.path not in ('', '/') or parts.query:
        raise PageError(f'--origin {given}: must be https://NAME or https://NAME:PORT')
    return f'https://{parts.netloc.removesuffix(":443")}'
