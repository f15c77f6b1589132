"""The MQTT broker of the demo: amqtt (the extra `demo`) in a thread with an event loop.

It supports only MQTT 3.1.1 and is meant for the demo alone.
"""

import asyncio
import logging
import socket
import threading

from bridge.errors import BridgeError
from bridge.installed import how_to_add

_START_S = 10.0
_STOP_S = 3.0


class DemoBroker:
    """A broker on a loopback port. One thread calls `start` and `stop`."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="demo broker", daemon=True)

    def start(self) -> None:
        """Start the broker; return when it listens.

        Raises:
            BridgeError: It could not be started; the message says why.
        """
        self._thread.start()
        if not self._ready.wait(_START_S):
            raise BridgeError(f"the embedded broker did not start within {_START_S:.0f} s")
        if self._failure is not None:
            raise BridgeError(f"the embedded broker could not start: {self._failure}")

    def stop(self) -> None:
        """Stop it, with its connections."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(_STOP_S)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except Exception as error:  # noqa: BLE001  # ends the thread; `start` tells
            self._failure = error
            self._ready.set()
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        try:
            from amqtt.broker import Broker  # noqa: PLC0415  # an extra: only the demo needs it
        except ImportError as error:
            raise BridgeError(
                f"its library amqtt is missing (extra `demo`): {how_to_add('amqtt')}"
            ) from error
        logging.getLogger("amqtt").setLevel(logging.CRITICAL)
        logging.getLogger("transitions").setLevel(logging.CRITICAL)
        # asyncio ends a connection in which an error was, and its client connects again: the user
        # need not see it. amqtt fails if a client subscribes while another one connects.
        self._loop.set_exception_handler(lambda _loop, _context: None)
        broker = Broker(
            {
                "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{self.port}"}},
                "plugins": {
                    "amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}
                },
            }
        )
        await broker.start()
        self._ready.set()
        await self._stop.wait()
        await broker.shutdown()


def free_port(wanted: int) -> int:
    """Return `wanted` if this loopback port is free, else another port."""
    for port in (wanted, 0):
        with socket.socket() as probe:
            # Bound as the broker does it: a port in TIME_WAIT is free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise BridgeError("no port is free on 127.0.0.1")
