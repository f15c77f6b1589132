"""`make docs`: writes the pages anew."""

from pathlib import Path

from reference.page import pages

FOLDER = Path(__file__).parents[2] / "docs" / "commands"


def main() -> None:
    """Writes what is to be there, and removes what is not."""
    FOLDER.mkdir(exist_ok=True)
    wanted = pages()
    for path in FOLDER.iterdir():
        if path.name not in wanted:
            path.unlink()
    for name, text in wanted.items():
        (FOLDER / name).write_text(text)


if __name__ == "__main__":
    main()
