"""The bridge, except that it connects again after moments: a thousand reconnects in minutes."""

import sys
from functools import partial
from unittest.mock import patch

from bridge.cli.main import main
from bridge.mqtt.reconnect import Backoff

PAUSE_S = 0.05

if __name__ == "__main__":
    backoff = partial(Backoff, first_s=PAUSE_S, longest_s=PAUSE_S)
    with patch("bridge.mqtt.client.Backoff", backoff):
        sys.exit(main())
