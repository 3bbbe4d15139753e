# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A pair of Ed25519 keys for the seals of an audit log, made as the docs say."""

from pathlib import Path
import subprocess


def make_keys(folder: Path) -> tuple[Path, Path]:
    """Write a private and a public key into a new folder, and return their paths."""
    folder.mkdir()
    key, public = folder / 'key', folder / 'public'
    subprocess.run(['openssl', 'genpkey', '-algorithm', 'ed25519', '-out', key], check=True)
    subprocess.run(['openssl', 'pkey', '-in', key, '-pubout', '-out', public], check=True)
    key.chmod(0o600)
    return key, public
