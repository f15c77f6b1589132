"""Runs the command `wisco2mqtt` as `python -m bridge`."""

from bridge.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
