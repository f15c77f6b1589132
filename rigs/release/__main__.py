"""`make release-check`: builds a release twice and compares; writes all that would be published."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from packages.deb import build_deb
from packages.shell import ROOT, commit_epoch, export, run

from bridge import __version__
from release.notes import disagreements, notes

DIST = ROOT / "dist"
LOCK = ROOT / "requirements" / "debian.txt"
# The wheel is of use without these, so that no other test would miss them.
IN_WHEEL = ("bridge/py.typed", "share/man/man1/wisco2mqtt.1", "wisco2mqtt/config.example.yaml")
IN_SDIST = ("docs/man/wisco2mqtt.1", "packaging/debian/control", "systemd/wisco2mqtt.service")


def main() -> int:
    """Returns 0 where everything agrees."""
    changelog = (ROOT / "CHANGELOG.md").read_text()
    tags = _tags()
    problems = disagreements(__version__, tags, changelog)
    if run("git", "status", "--porcelain").strip():
        problems.append("there are changes that are not committed: what is built is the commit")
    problems += _wrong_repository()
    problems += _build_twice()
    _write_sbom(DIST / f"wisco2mqtt-{__version__}.cdx.json")
    run(sys.executable, "-m", "twine", "check", "--strict", *map(str, _python_artifacts()))
    problems += _missing()
    _write_checksums()
    (DIST / "NOTES.md").write_text(notes(changelog))  # no file to download: the text of the release
    print((DIST / "SHA256SUMS").read_text(), end="")
    for problem in problems:
        print(f"release-check: {problem}", file=sys.stderr)
    told = "nothing is wrong" if not problems else f"{len(problems)} things are wrong"
    rehearsal = "" if tags else f"; a rehearsal: the tag v{__version__} is not there"
    print(f"release-check: version {__version__}: {told}{rehearsal}")
    return 1 if problems else 0


def _tags() -> list[str]:
    """Returns the tags of the commit, and the one that a workflow was started by."""
    of_workflow = os.environ.get("GITHUB_REF_NAME", "")
    started_by = {of_workflow} if os.environ.get("GITHUB_REF_TYPE") == "tag" else set()
    return sorted({*run("git", "tag", "--points-at", "HEAD").split(), *started_by})


def _wrong_repository() -> list[str]:
    """Where GitHub builds it, the addresses in its metadata are those of this repository."""
    repository = os.environ.get("GITHUB_REPOSITORY")
    if not repository or f"github.com/{repository}" in (ROOT / "pyproject.toml").read_text():
        return []
    return [f"the urls in pyproject.toml are not of {repository}"]


def _build_twice() -> list[str]:
    """Builds in two folders, with another umask and zone of time; the first one stays."""
    shutil.rmtree(DIST, ignore_errors=True)
    DIST.mkdir()
    with tempfile.TemporaryDirectory(prefix="wisco2mqtt-release-") as second:
        _build(DIST, umask=0o022, zone="UTC")
        _build(Path(second), umask=0o077, zone="Asia/Bangkok")
        first, again = _checksums(DIST), _checksums(Path(second))
    return [
        f"{name} is not the same when it is built again"
        for name in sorted(first.keys() | again.keys())
        if first.get(name) != again.get(name)
    ]


def _build(target: Path, *, umask: int, zone: str) -> None:
    environment = {**os.environ, "SOURCE_DATE_EPOCH": commit_epoch(), "TZ": zone}
    with tempfile.TemporaryDirectory(prefix="wisco2mqtt-source-") as folder:
        source = Path(folder) / "source"
        export(source)
        command = (sys.executable, "-m", "build", "--no-isolation", "--outdir", str(target), ".")
        subprocess.run(
            command, cwd=source, env=environment, umask=umask, check=True, stdout=subprocess.DEVNULL
        )
    shutil.copy(build_deb("bookworm"), target)


def _python_artifacts() -> list[Path]:
    return [*DIST.glob("*.whl"), *DIST.glob("*.tar.gz")]


def _missing() -> list[str]:
    """Returns what a wheel or an sdist lacks."""
    wheel, sdist = _python_artifacts()
    with zipfile.ZipFile(wheel) as in_wheel, tarfile.open(sdist) as in_sdist:
        held = {wheel: in_wheel.namelist(), sdist: in_sdist.getnames()}
    wanted = {wheel: IN_WHEEL, sdist: IN_SDIST}
    return [
        f"{path.name} lacks {end}"
        for path, ends in wanted.items()
        for end in ends
        if not any(name.endswith(end) for name in held[path])
    ]


def _write_sbom(path: Path) -> None:
    """Lists what the Debian package contains; it is what pip takes, with the extra `cli`."""
    command = ("requirements", str(LOCK), "--pyproject", str(ROOT / "pyproject.toml"))
    more = ("--mc-type", "application", "--output-reproducible", "--sv", "1.6")
    # It warns that we say what depends on what: below.
    quietly = ("-W", "ignore::UserWarning")
    run(sys.executable, *quietly, "-m", "cyclonedx_py", *command, *more, "--output-file", str(path))
    document = json.loads(path.read_text())
    component = document["metadata"]["component"]
    component["version"] = __version__  # pyproject.toml leaves it to bridge/__init__.py
    root = component["bom-ref"]
    others = sorted(part["bom-ref"] for part in document["components"])
    parts = [part for part in document["dependencies"] if part["ref"] != root]
    document["dependencies"] = [*parts, {"ref": root, "dependsOn": others}]
    path.write_text(json.dumps(document, indent=2, sort_keys=True) + "\n")


def _write_checksums() -> None:
    lines = (f"{digest}  {name}\n" for name, digest in sorted(_checksums(DIST).items()))
    (DIST / "SHA256SUMS").write_text("".join(lines))


def _checksums(folder: Path) -> dict[str, str]:
    return dict(_digests(folder))


def _digests(folder: Path) -> Iterator[tuple[str, str]]:
    for path in folder.iterdir():
        yield path.name, hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    sys.exit(main())
