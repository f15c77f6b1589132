"""A line on real ports: a pty at a stable path, or TCP; its thread, its pace, its end."""

import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from support.line_master import LineMaster
from support.open_files import open_files

from bridge.model import DIO100, DO100
from bridge.simulator import (
    Direction,
    PtyEndpoint,
    SimulatedLine,
    SimulatedModule,
    TcpEndpoint,
)
from bridge.simulator.endpoint import Endpoint

ASK, REPLY = b"#01RDIH\r", b"DI>0000\r"
RTU_ASK = bytes.fromhex("0101000000083DCC")
SOON_S = 0.2  # how long silence is listened to


def wisco_line(
    endpoint: Endpoint | None = None, *, paced: bool = False, turnaround_s: float = 0.0
) -> SimulatedLine:
    """A DIO100 at 1 and a DO100 at 13."""
    modules = [SimulatedModule(DIO100, address=1), SimulatedModule(DO100, address=13)]
    return SimulatedLine(
        "wisco", 9600, modules, paced=paced, turnaround_s=turnaround_s, endpoint=endpoint
    )


def endpoint_of(over_tcp: bool, baud: int = 9600) -> Endpoint:
    """Return the endpoint for the next line."""
    return TcpEndpoint() if over_tcp else PtyEndpoint(baud=baud)


def eventually(condition: Callable[[], bool]) -> bool:
    """Waits for a condition, with a generous deadline."""
    deadline = time.monotonic() + 10
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return condition()


@pytest.fixture(params=["pty", "tcp"])
def over_tcp(request: pytest.FixtureRequest) -> bool:
    """One way to reach a line, and then the other."""
    return bool(request.param == "tcp")


def test_exchanges(over_tcp: bool) -> None:
    """Requests are answered, inputs follow the test, the outputs are there for it to see."""
    with wisco_line(endpoint_of(over_tcp)) as line, LineMaster(line.port) as master:
        assert master.ask(ASK, len(REPLY)) == REPLY
        line.module(1).set_input(16, True)
        assert master.ask(ASK, len(REPLY)) == b"DI>8000\r"
        assert master.ask(b"#0DWDOX8001,8001\r", 6) == b"DO>OK\r"
        assert line.module(13).outputs == 0x8001
        assert master.ask(b":010200000010ED\r\n", 15) == b":0102020080" + b"7B\r\n"


def test_rtu(over_tcp: bool) -> None:
    """RTU passes as it is, every byte value."""
    module = SimulatedModule(DIO100, address=1)
    endpoint = endpoint_of(over_tcp, 57600)
    line = SimulatedLine(
        "modbus-rtu", 57600, [module], endpoint=endpoint, paced=False, turnaround_s=0.0
    )
    with line, LineMaster(line.port) as master:
        assert master.ask(RTU_ASK, 6) == bytes.fromhex("010101005188")
        for number in range(0x100):
            module.write_outputs(0xFF, number, b"")
            assert master.ask(RTU_ASK, 6)[3] == number


def test_log_holds_what_passed(over_tcp: bool) -> None:
    """The log has both directions in the order of time."""
    with wisco_line(endpoint_of(over_tcp)) as line, LineMaster(line.port) as master:
        master.ask(ASK, len(REPLY))
        entries = [(entry.direction, entry.data) for entry in line.log]
    assert entries == [(Direction.TO_MODULES, ASK), (Direction.TO_MASTER, REPLY)]
    assert line.log[0].at <= line.log[1].at


def test_reply_is_not_faster_than_the_wire(over_tcp: bool) -> None:
    """A paced line takes at least the wire's time and the turnaround."""
    line = wisco_line(endpoint_of(over_tcp), paced=True, turnaround_s=0.03)
    with line, LineMaster(line.port) as master:
        began = time.monotonic()
        assert master.ask(ASK, len(REPLY)) == REPLY
        assert time.monotonic() - began >= 16 * 10 / 9600 + 0.03


def test_pulse_ends_without_anybody_asking(over_tcp: bool) -> None:
    """The line's thread ends pulses, so that who watches a module sees it."""
    ends: list[bool] = []
    module = SimulatedModule(
        DIO100, address=1, listener=lambda _, switching: ends.append(switching.value)
    )
    module.set_mode(1, pulse=True, hold_s=0.1)
    with SimulatedLine("wisco", 9600, [module], endpoint=endpoint_of(over_tcp)) as line:
        with LineMaster(line.port) as master:
            assert master.ask(b"#01WDO1,1\r", 6) == b"DO>OK\r"
        assert eventually(lambda: ends == [True, False])
        on, off = module.switchings
        assert off.at - on.at == pytest.approx(0.1)


def test_hang_up_and_restore_at_the_same_port(over_tcp: bool) -> None:
    """The master sees a hang-up; afterwards the line is back where it was, modules as before."""
    with wisco_line(endpoint_of(over_tcp)) as line:
        port = line.port
        line.module(1).set_input(1, True)
        for _ in range(3):
            with LineMaster(port) as master:
                assert master.ask(ASK, len(REPLY)) == b"DI>0001\r"
                line.hang_up()
                assert master.hung_up()
            with pytest.raises(OSError, match=r"No such file|refused"):
                LineMaster(port)
            line.restore()
        with LineMaster(port) as master:
            line.restore()  # of a line that is up: nothing happens
            assert master.ask(ASK, len(REPLY)) == b"DI>0001\r"


def test_hang_up_fault_restores_itself(over_tcp: bool) -> None:
    """A hang-up by fault comes on a request and is over after its delay."""
    with wisco_line(endpoint_of(over_tcp)) as line:
        line.faults.set("hang-up", times=1, delay_s=0.05)
        with LineMaster(line.port) as master:
            master.send(ASK)
            assert master.hung_up()

        def back() -> bool:
            try:
                with LineMaster(line.port) as again:
                    return again.ask(ASK, len(REPLY), SOON_S) == REPLY
            except OSError:
                return False

        assert eventually(back)


def test_injected_bytes_reach_the_master(over_tcp: bool) -> None:
    """Bytes that were not requested come through."""
    with wisco_line(endpoint_of(over_tcp)) as line, LineMaster(line.port) as master:
        master.ask(ASK, len(REPLY))  # over TCP: the connection has been accepted
        line.inject(b"\x00foreign")
        assert master.receive(8) == b"\x00foreign"


def test_nothing_is_left_behind(over_tcp: bool) -> None:
    """After the end: no thread, no descriptor, no path; and the end comes promptly."""
    threads, descriptors = {thread.name for thread in threading.enumerate()}, open_files()
    port = ""
    for _ in range(3):
        line = wisco_line(endpoint_of(over_tcp), paced=True)
        with line, LineMaster(line.port) as master:
            line.faults.set("late", delay_s=60)
            master.send(ASK)
            line.hang_up()
            line.restore()
            port = line.port
        line.stop()
    assert {thread.name for thread in threading.enumerate()} == threads
    assert open_files() == descriptors
    assert over_tcp or not Path(port).parent.exists()


def test_line_that_does_not_run_cannot_hang_up() -> None:
    """A slip of a test is told, and does not wait for ever."""
    with pytest.raises(RuntimeError, match="line is not running"):
        wisco_line().hang_up()


def test_flood_that_nobody_reads_does_not_block_the_line() -> None:
    """Bytes that the master does not take are lost; the line ends all the same."""
    with wisco_line() as line, LineMaster(line.port) as master:
        line.faults.set("flood")
        for _ in range(100):
            master.send(ASK)
        assert eventually(lambda: sum(len(entry.data) for entry in line.log) > 50_000)


# --- pty ---


def test_link_is_made_where_it_is_wanted(tmp_path: Path) -> None:
    """A given path becomes a link to the pty, takes the place of an old link, and goes away."""
    path = tmp_path / "ttyWISCO"
    path.symlink_to("/nowhere")
    with wisco_line(PtyEndpoint(path, baud=9600)) as line, LineMaster(str(path)) as master:
        assert line.port == str(path)
        assert path.readlink().is_relative_to("/dev/pts")
        assert master.ask(ASK, len(REPLY)) == REPLY
    assert list(tmp_path.iterdir()) == []


def test_file_in_the_way_is_left_alone(tmp_path: Path) -> None:
    """A file at the path of the link is not replaced."""
    path = tmp_path / "precious"
    path.write_text("data")
    descriptors = open_files()
    line = wisco_line(PtyEndpoint(path, baud=9600))
    with pytest.raises(FileExistsError, match="precious is there already"):
        line.start()
    line.stop()
    assert path.read_text() == "data"
    assert open_files() == descriptors


def test_master_with_another_baud_rate_is_not_understood() -> None:
    """On a pty the speed that the master sets counts, as on a wire."""
    with wisco_line() as line, LineMaster(line.port) as master:
        for speed, answered in ((termios.B19200, False), (termios.B9600, True)):
            attributes = termios.tcgetattr(master.fileno)
            attributes[4] = attributes[5] = speed
            termios.tcsetattr(master.fileno, termios.TCSANOW, attributes)
            patience_s = 10 if answered else SOON_S
            assert (master.ask(ASK, len(REPLY), patience_s) == REPLY) is answered


# --- TCP ---


def test_new_connection_takes_the_place_of_the_old() -> None:
    """A master that comes back does not wait for its own dead connection."""
    with wisco_line(TcpEndpoint()) as line, LineMaster(line.port) as old:
        assert old.ask(ASK, len(REPLY)) == REPLY
        with LineMaster(line.port) as new:
            assert new.ask(ASK, len(REPLY)) == REPLY
            assert old.hung_up()


def test_connection_that_ends_leaves_the_line_up() -> None:
    """A master may come and go."""
    with wisco_line(TcpEndpoint()) as line:
        for _ in range(5):
            with LineMaster(line.port) as master:
                assert master.ask(ASK, len(REPLY)) == REPLY


def test_reply_to_nobody_is_lost() -> None:
    """A reply for a connection that is gone does no harm."""
    with wisco_line(TcpEndpoint(), turnaround_s=0.05) as line:
        with LineMaster(line.port) as master:
            master.send(ASK * 100)
            assert eventually(lambda: bool(line.log))
        # It is still there when the 100 replies have met nobody, or the next master.
        with LineMaster(line.port) as master:
            assert master.ask(ASK, len(REPLY)) == REPLY


def test_port_in_use_is_told() -> None:
    """Two lines cannot have one TCP port."""
    with wisco_line(TcpEndpoint()) as line:
        port = int(line.port.rpartition(":")[2])
        second = wisco_line(TcpEndpoint(port))
        with pytest.raises(OSError, match="in use"):
            second.start()
        second.stop()


def test_port_taken_while_hung_up_is_told() -> None:
    """If another program took the TCP port, `restore` raises, and can be called again."""
    with wisco_line(TcpEndpoint()) as line:
        line.hang_up()
        other = wisco_line(TcpEndpoint(int(line.port.rpartition(":")[2])))
        with other, pytest.raises(OSError, match="in use"):
            line.restore()
        line.restore()
        with LineMaster(line.port) as master:
            assert master.ask(ASK, len(REPLY)) == REPLY
