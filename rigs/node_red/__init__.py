"""The example flows of docs/node-red/: looked at in `make test`, run by `make test-node-red`."""
