"""`make docs`: writes the pages anew."""

from collections.abc import Mapping
from pathlib import Path

from reference.man import man_pages
from reference.page import pages

FOLDER = Path(__file__).parents[2] / "docs" / "commands"
MAN_FOLDER = FOLDER.with_name("man")


def main() -> None:
    """Writes both forms of the reference."""
    _write(FOLDER, pages())
    _write(MAN_FOLDER, man_pages())


def _write(folder: Path, wanted: Mapping[str, str]) -> None:
    """Writes what is to be there, and removes what is not."""
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in wanted:
            path.unlink()
    for name, text in wanted.items():
        (folder / name).write_text(text)


if __name__ == "__main__":
    main()
