"""A certificate authority of our own and a server certificate for localhost, by openssl."""

import subprocess
from pathlib import Path

_KEY = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
_SERVER = """\
basicConstraints=CA:FALSE
keyUsage=critical,digitalSignature
extendedKeyUsage=serverAuth
subjectAltName=DNS:localhost,IP:127.0.0.1
authorityKeyIdentifier=keyid
"""


def make_certificates(directory: Path) -> None:
    """Writes `ca.crt`, `server.crt` and their keys, valid for two days."""
    make_authority(directory)
    (directory / "server.ext").write_text(_SERVER)
    request = ("-keyout", "server.key", "-out", "server.csr", "-subj", "/CN=localhost")
    _openssl(directory, "req", *_KEY, *request)
    signing = ("-CA", "ca.crt", "-CAkey", "ca.key", "-CAcreateserial", "-extfile", "server.ext")
    outcome = ("-in", "server.csr", "-out", "server.crt", "-days", "2")
    _openssl(directory, "x509", "-req", *signing, *outcome)


def make_authority(directory: Path) -> None:
    """Writes `ca.crt` and `ca.key`: alone, an authority that signed nothing."""
    usage = ("-addext", "keyUsage=critical,keyCertSign,cRLSign")
    outcome = ("-keyout", "ca.key", "-out", "ca.crt", "-subj", "/CN=Test authority", "-days", "2")
    _openssl(directory, "req", "-x509", *_KEY, *usage, *outcome)


def _openssl(directory: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=directory, check=True, capture_output=True)
