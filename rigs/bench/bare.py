"""The bare loop: pyserial, a request, its reply, the silence, the next. Nothing else is done.

The arguments: port, baud, silence in seconds, how many seconds, then each request in hex with
the length of its reply, as `0102...:7`.
"""

import sys
import time

import serial


def main(port: str, baud: str, silence_s: str, seconds: str, *requests: str) -> None:
    """Asks in turn until the time is over."""
    pairs = [request.split(":") for request in requests]
    asked = [(bytes.fromhex(frame), int(size)) for frame, size in pairs]
    silence = float(silence_s)
    end = time.monotonic() + float(seconds)
    with serial.Serial(port, int(baud), timeout=0.5) as line:
        quiet_from = time.monotonic()
        while time.monotonic() < end:
            for frame, size in asked:
                left = quiet_from + silence - time.monotonic()
                if left > 0:
                    time.sleep(left)
                line.write(frame)
                if len(line.read(size)) < size:
                    sys.exit("a reply is missing")
                quiet_from = time.monotonic()


if __name__ == "__main__":
    main(*sys.argv[1:])
