"""`python -m bridge` is the command `wisco2mqtt`."""

from bridge.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
