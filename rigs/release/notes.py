"""What a release says of itself: its version, its tag and its section of CHANGELOG agree."""

import re

_HEADING = re.compile(r"^## \[(?P<name>[^\]]+)\]", re.MULTILINE)
_UNRELEASED = "Unreleased"


def disagreements(version: str, tags: list[str], changelog: str) -> list[str]:
    """Return what does not agree; a rehearsal has no tag, and may have its heading to come."""
    wanted = f"v{version}"
    found = []
    if tags and wanted not in tags:
        found.append(f"the tag is {', '.join(tags)}, and bridge/__init__.py has {version}")
    allowed = {version} if tags else {version, _UNRELEASED}
    heading = _newest(changelog)
    if heading not in allowed:
        found.append(f"CHANGELOG.md begins with [{heading}], and not with [{version}]")
    return found


def notes(changelog: str) -> str:
    """Return the newest section of CHANGELOG, without its heading."""
    _, _, after = changelog.partition(f"## [{_newest(changelog)}]")
    _, _, body = after.partition("\n")
    end = _HEADING.search(body)
    return (body[: end.start()] if end else body).strip() + "\n"


def _newest(changelog: str) -> str:
    found = _HEADING.search(changelog)
    return found["name"] if found else "nothing"
