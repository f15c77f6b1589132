"""The panel's tools: F22, what was dumped from one kind of module is not restored onto another."""

import io
import itertools
import os
import time
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

from bridge.cli.main import main
from bridge.commission.image import ImageFormat, write_image
from bridge.model import DIO100, DO100, LineProtocol, ModuleType
from bridge.protocol.wisco_eeprom import EEPROM_BYTES
from bridge.simulator.line import SimulatedLine
from bridge.simulator.module import SimulatedModule
from proofs.figures import Figure, Run, Scale, proof

_STATION = 13
_MODELS = (DIO100, DO100)
_PROTOCOLS = (LineProtocol.WISCO, LineProtocol.MODBUS_ASCII)
_MOST_S = 5.0  # generous: what is not refused at once hangs for ever
_END = ":00000001FF\n"


@dataclass(frozen=True, slots=True)
class _Case:
    """A command line on the one module, but for its place; and its file."""

    words: tuple[str, ...]
    taken: bool = False  # it is no mix-up: this has to work


@proof("F22")
def nothing_is_mixed_up(run: Run) -> Figure:
    """Images and settings of the other model, parts, and what is no file, on real command lines."""
    refused, taken, wrong, longest_s = 0, 0, [], 0.0
    lines = list(itertools.product(_MODELS, _PROTOCOLS))[:: run.scale.of(3, 1)]
    for number, (model, protocol) in enumerate(lines):
        folder = run.directory / f"{number}"
        folder.mkdir()
        with _line(model, protocol) as line:
            for case in _cases(folder, model, run.scale):
                said, took_s = _run_on(line, case)
                wrong += [f"{model.name} {protocol} {case.words}: {said}"] if said else []
                refused += not (case.taken or said)
                taken += case.taken and not said
                longest_s = longest_s if case.taken else max(longest_s, took_s)
    print("\n".join(wrong), end="")
    return Figure(
        injected=f"{refused + taken + len(wrong)} files on {len(lines)} modules and protocols",
        seen=f"{refused} refused in a line, 0 bytes written; {taken} right ones taken"
        if not wrong
        else f"{len(wrong)} went wrong, the first: {wrong[0]}",
        promised=f"every mix-up refused, each within {_MOST_S:g} s",
        kept=not wrong and longest_s < _MOST_S,
    )


def _line(model: ModuleType, protocol: LineProtocol) -> SimulatedLine:
    module = SimulatedModule(model, _STATION)
    return SimulatedLine(protocol, 57600, [module], paced=False, turnaround_s=0.0)


def _run_on(line: SimulatedLine, case: _Case) -> tuple[str, float]:
    """Runs it; tells what is wrong with how it ended, if anything, and how long it took."""
    module = line.module(_STATION)
    writes = module.eeprom_writes
    place = ("--port", line.port, "--station", f"{_STATION}", "--baud", f"{line.baud}")
    began = time.monotonic()
    status, told = _ended((*case.words, *place, "--protocol", line.protocol, "--yes"))
    took_s = time.monotonic() - began
    if case.taken:
        return "" if status == 0 else f"exit {status}: {told}", took_s
    if status not in {1, 2, 78} or told.count("\n") != 1:
        return f"exit {status}: {told}", took_s
    return f"{module.eeprom_writes - writes} writes" * (module.eeprom_writes != writes), took_s


def _ended(words: tuple[str, ...]) -> tuple[int, str]:
    told = io.StringIO()
    with redirect_stderr(told), redirect_stdout(io.StringIO()):
        try:
            status = main(words)
        except SystemExit as end:
            status = int(end.code or 0)
    return status, told.getvalue()


# --- what is tried ---


def _cases(folder: Path, model: ModuleType, scale: Scale) -> Iterator[_Case]:
    (other,) = set(_MODELS) - {model}
    yield from _of_models(folder, model, other)
    yield from _of_sizes(folder, model, scale)
    yield from _of_damage(folder)
    yield from _of_settings(folder, model, other)
    for path in (*_no_files(folder), _huge(folder)):
        yield _Case(("eeprom", "restore", path, "--format", "hex", "--from", model.name))
        yield _Case(("eeprom", "restore", path, "--format", "bin", "--from", model.name))
        yield _Case(("settings", "apply", path))


def _of_models(folder: Path, model: ModuleType, other: ModuleType) -> Iterator[_Case]:
    """A whole image in both formats, with all that can be said of its model."""
    data = bytes(EEPROM_BYTES)
    for image_format, of in itertools.product(ImageFormat, (model, other)):
        path = folder / f"{of.name}.{image_format}"
        write_image(path, image_format, data, of)
        says = of if image_format is ImageFormat.HEX else None
        restore = ("eeprom", "restore", str(path))
        yield _Case(restore, taken=says == model)
        for given in (model, other):
            right = given == model and says in {model, None}
            yield _Case((*restore, "--from", given.name), taken=right)
    bare = folder / "bare.hex"
    bare.write_text(f":0100000012ED\n{_END}")
    yield _Case(("eeprom", "restore", str(bare)))
    yield _Case(("eeprom", "restore", str(bare), "--from", other.name))


def _of_sizes(folder: Path, model: ModuleType, scale: Scale) -> Iterator[_Case]:
    """Raw images of every length but the right one, or of some."""
    few = [0, 1, 100, 1024, EEPROM_BYTES - 1, EEPROM_BYTES + 1, 2 * EEPROM_BYTES]
    for size in few if scale is Scale.SHORT else range(0, 2 * EEPROM_BYTES + 1, 7):
        path = folder / f"{size}.bin"
        path.write_bytes(b"\x55" * size)
        yield _Case(("eeprom", "restore", str(path), "--from", model.name))


def _of_damage(folder: Path) -> Iterator[_Case]:
    """Intel HEX that ends too early, goes on behind its end, or is of an unknown model."""
    whole = (folder / "DIO100.hex").read_text()
    for number, text in enumerate(
        (whole[: len(whole) // 2], whole + whole, f"{whole}:0100000012ED\n", "", "\n" * 9999,
         whole.replace("DIO100", "DIO200"), f"{whole}; EEPROM of a DO100\n",
         f":0108000012E5\n{_END}", f":020000040001F9\n:0100000012ED\n{_END}")
    ):  # fmt: skip
        path = folder / f"damaged-{number}.hex"
        path.write_text(text)
        yield _Case(("eeprom", "restore", str(path)))


def _of_settings(folder: Path, model: ModuleType, other: ModuleType) -> Iterator[_Case]:
    """Settings of either model, of more outputs than there are, and files of the other kind."""
    texts = {
        "own": f"model: {model.name}\noutputs: {{1: {{mode: pulse, hold: 0.5s}}}}\n",
        "other": f"model: {other.name}\noutputs: {{1: {{mode: pulse, hold: 0.5s}}}}\n",
        "lacking": f"outputs: {{{model.outputs + 1}: {{mode: pulse}}}}\n",
        "unknown": "model: DIO200\noutputs: {1: {mode: pulse}}\n",
    }
    for name, text in texts.items():
        path = folder / f"{name}.yaml"
        path.write_text(text)
        yield _Case(("settings", "apply", str(path)), taken=name == "own")
    yield _Case(("settings", "apply", str(folder / f"{model.name}.hex")))
    yield _Case(("eeprom", "restore", str(folder / "own.yaml"), "--format", "hex"))


def _no_files(folder: Path) -> list[str]:
    """Return files without an end, or without content."""
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    return [str(pipe), str(folder), "/dev/zero", "/dev/random", str(folder / "gone")]


def _huge(folder: Path) -> str:
    path = folder / "huge"
    with path.open("wb") as file:
        file.truncate(2**36)  # a hole: it takes no room
    return str(path)
