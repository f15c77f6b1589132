import subprocess
import sys

import pytest

from bridge.transport.lock import LockHeldError, take_lock

HOLDER = """
import sys
from bridge.transport.lock import take_lock
lock = take_lock(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize("name", ["test of locks", "test of locks " + "x" * 500, "test ä"])
def test_a_lock_is_taken_once(name: str) -> None:
    """The second one is told so, and gets it once the first has given it back."""
    with take_lock(name):
        with pytest.raises(LockHeldError, match="another program on this machine"):
            take_lock(name)
        take_lock(f"{name}.").release()  # another name is another lock
    take_lock(name).release()


def test_a_lock_ends_with_its_process() -> None:
    """A lock ends with its process, however that ends."""
    command = [sys.executable, "-c", HOLDER, "test of dying"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with pytest.raises(LockHeldError):
            take_lock("test of dying")
        holder.kill()
        holder.wait()
    take_lock("test of dying").release()
