"""Checks that the codecs share: arguments in range, characters of an alphabet, prefixes."""

HEX = b"0123456789ABCDEF"  # as the manual has it (docs/protocol.md section 2)
_LOWER_HEX = b"0123456789abcdef"

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


def hex_digits(text: bytes) -> bytes:
    """Return `text`; raise ValueError unless it is hex digits, all of one case.

    `int` and `bytes.fromhex` are not used for this: they accept blanks and underscores too.

    docs/protocol.md, reading hex-case: lower case is taken too. No single flipped bit makes one of
    these letters of a digit, and one that turns the case leaves the value.
    """
    if text.translate(None, _LOWER_HEX) and (strange := text.translate(None, HEX)):
        raise ValueError(f"{strange!r} is outside the alphabet")
    return text


def exactly_hex(text: bytes, length: int) -> bytes:
    """Return `text`; raise ValueError unless it is `length` hex digits."""
    if len(text) != length:
        raise ValueError(f"{len(text)} characters came where {length} are due")
    return hex_digits(text)
