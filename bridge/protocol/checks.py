"""Checks that the codecs share: arguments in range, characters of an alphabet, prefixes."""

BINARY = b"01"
HEX = b"0123456789ABCDEF"  # the modules write upper case only (docs/protocol.md section 2)

# Noise before a reply is limited to this: the bus does not wait for a line that sends endlessly.
NOISE_CHARS = 256


def in_range(what: str, value: int, low: int, high: int) -> int:
    """Return `value`; raise ValueError when it is outside `low` to `high`."""
    if not low <= value <= high:
        raise ValueError(f"{what} {value} is not in {low}-{high}")
    return value


def within_width(what: str, bits: int, width: int) -> int:
    """Return `bits`; raise ValueError when it names a channel above `width`."""
    if not 0 <= bits < 1 << width:
        raise ValueError(f"{what} {bits:X}h has bits outside the {width} channels")
    return bits


def nonempty_mask(mask: int, width: int) -> int:
    """Return `mask`; raise ValueError when it names no channel, or one above `width`."""
    if not mask:
        raise ValueError("the mask names no output")
    return within_width("mask", mask, width)


def only(text: bytes, alphabet: bytes) -> bytes:
    """Return `text`; raise ValueError when a character is outside `alphabet`.

    `int` and `bytes.fromhex` are not used for this: they accept lower case, blanks and underscores
    too.
    """
    if strange := text.translate(None, alphabet):
        raise ValueError(f"{strange!r} is outside the alphabet")
    return text


def exactly(text: bytes, length: int, alphabet: bytes) -> bytes:
    """Return `text`; raise ValueError unless it is `length` characters of `alphabet`."""
    if len(text) != length:
        raise ValueError(f"{len(text)} characters came where {length} are due")
    return only(text, alphabet)
