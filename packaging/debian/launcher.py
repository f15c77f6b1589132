#!/usr/bin/python3 -I
"""wisco2mqtt, with its own libraries and those of Debian's Python, and no others."""

import sys

sys.path.insert(0, "/usr/lib/wisco2mqtt")

from bridge.cli.main import main  # only found below that folder

sys.exit(main())
