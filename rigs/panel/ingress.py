"""A proxy with a path and a name of its own before the panel, as Home Assistant's ingress is."""

import contextlib
import socket
import threading
from collections.abc import Iterator

PATH = "/api/hassio_ingress/k3y"
_NAME = b"house.example"


@contextlib.contextmanager
def ingress(web: int) -> Iterator[str]:
    """Return where the panel is behind it."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=_serve, args=(listener, web), daemon=True).start()
        yield f"http://127.0.0.1:{listener.getsockname()[1]}{PATH}/"


def _serve(listener: socket.socket, web: int) -> None:
    while True:
        try:
            client, _ = listener.accept()
        except OSError:
            return
        threading.Thread(target=_pass_on, args=(client, web), daemon=True).start()


def _pass_on(client: socket.socket, web: int) -> None:
    """One request: its path is cut, its name replaced; the panel closes after its answer."""
    with (
        client,
        socket.create_connection(("127.0.0.1", web)) as panel,
        contextlib.suppress(OSError),
    ):
        data = b""
        while b"\r\n\r\n" not in data:
            if not (piece := client.recv(65536)):
                return
            data += piece
        head, _, body = data.partition(b"\r\n\r\n")
        first, *lines = head.split(b"\r\n")
        method, path, version = first.split(b" ")
        cut = path.removeprefix(PATH.encode()) if path.startswith(PATH.encode()) else b"/nothing"
        kept = [line for line in lines if not line.lower().startswith((b"host:", b"connection:"))]
        kept += [b"Host: " + _NAME, b"X-Forwarded-For: 10.0.0.7"]
        panel.sendall(b"\r\n".join([b" ".join((method, cut, version)), *kept, b"", body]))
        threading.Thread(target=_pour, args=(client, panel), daemon=True).start()
        _pour(panel, client)


def _pour(source: socket.socket, target: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while data := source.recv(65536):
            target.sendall(data)
