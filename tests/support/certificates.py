"""A certificate authority of our own, with certificates for localhost and a client, by openssl."""

import subprocess
from pathlib import Path

_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
_COMMON = """\
basicConstraints=CA:FALSE
keyUsage=critical,digitalSignature
authorityKeyIdentifier=keyid
"""
_SERVER = "extendedKeyUsage=serverAuth\nsubjectAltName=DNS:localhost,IP:127.0.0.1\n"
_CLIENT = "extendedKeyUsage=clientAuth\n"


def make_certificates(directory: Path) -> None:
    """Writes `ca.crt`, `server.crt`, `client.crt` and their keys, valid for two days."""
    make_authority(directory)
    _sign(directory, "server", "localhost", _COMMON + _SERVER)
    _sign(directory, "client", "client", _COMMON + _CLIENT)


def make_authority(directory: Path) -> None:
    """Writes `ca.crt` and `ca.key`: alone, an authority that signed nothing."""
    usage = ("-addext", "keyUsage=critical,keyCertSign,cRLSign")
    outcome = ("-keyout", "ca.key", "-out", "ca.crt", "-subj", "/CN=Test authority", "-days", "2")
    _openssl(directory, "req", "-x509", *_KEY, *usage, *outcome)


def _sign(directory: Path, name: str, subject: str, extensions: str) -> None:
    (directory / f"{name}.ext").write_text(extensions)
    request = ("-keyout", f"{name}.key", "-out", f"{name}.csr", "-subj", f"/CN={subject}")
    _openssl(directory, "req", *_KEY, *request)
    signing = ("-CA", "ca.crt", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", f"{name}.ext")
    outcome = ("-in", f"{name}.csr", "-out", f"{name}.crt", "-days", "2")
    _openssl(directory, "x509", "-req", *signing, *outcome)


def _openssl(directory: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=directory, check=True, capture_output=True)
