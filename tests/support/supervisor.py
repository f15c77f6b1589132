"""A stub of Home Assistant's Supervisor: it tells an app of its broker."""

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

TOKEN = "of-the-supervisor"  # noqa: S105  # a stub's


@contextmanager
def supervisor(status: int, document: Mapping[str, Any]) -> Iterator[str]:
    """Answers as the Supervisor does: the data below `data`, and only with its token."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            mine = self.headers["Authorization"] == f"Bearer {TOKEN}"
            known = mine and self.path == "/services/mqtt"
            self.send_response(status if known else 401)
            self.end_headers()
            self.wfile.write(json.dumps(document if known else {}).encode())

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()
