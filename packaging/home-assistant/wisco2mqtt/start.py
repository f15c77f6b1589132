#!/usr/bin/env python3
"""Starts wisco2mqtt as an app of Home Assistant: the broker comes from the Supervisor."""

import json
import os
import sys
import urllib.error
import urllib.request
from pathlib import Path

# The secrets stand in no file: the environment has them, from the Supervisor and the options.
_CONFIG = """\
# The configuration of wisco2mqtt. The panel shows and saves it.
config_version: 2
mqtt:
  host: {host}
  port: {port}
{login}web:
  listen: 0.0.0.0:8099
  password: !env WISCO_PANEL_PASSWORD
  proxy: 172.30.32.2   # Home Assistant's ingress
lines: []
"""
_LOGIN = """\
  username: !env WISCO_MQTT_USERNAME
  password: !env WISCO_MQTT_PASSWORD
"""
_USUAL = {"host": "core-mosquitto", "port": 1883}  # until the owner writes another


def main(
    data: Path = Path("/data"),
    config: Path = Path("/config/config.yaml"),
    supervisor: str = "http://supervisor",
) -> None:
    """Becomes the program."""
    options = json.loads((data / "options.json").read_text())
    broker = _broker(supervisor)
    if not config.exists():
        login = _LOGIN if broker.get("username") else ""
        text = _CONFIG.format(host=broker["host"], port=broker["port"], login=login)
        if broker.get("ssl"):
            text = text.replace("web:", "  tls: {}\nweb:")
        config.write_text(text)
    secrets = {
        "WISCO_MQTT_USERNAME": broker.get("username", ""),
        "WISCO_MQTT_PASSWORD": broker.get("password", ""),
        "WISCO_PANEL_PASSWORD": options["panel_password"],
    }
    command = ("wisco2mqtt", "-c", str(config), "--log-level", options["log_level"], "run")
    os.execvpe(command[0], command, {**os.environ, **secrets, "STATE_DIRECTORY": str(data)})  # noqa: S606


def _broker(supervisor: str) -> dict[str, object]:
    """Returns what the Supervisor says of its broker, or the usual place of one."""
    request = urllib.request.Request(f"{supervisor}/services/mqtt")  # noqa: S310  # http alone
    request.add_header("Authorization", f"Bearer {os.environ.get('SUPERVISOR_TOKEN', '')}")
    try:
        with urllib.request.urlopen(request, timeout=10) as answer:  # noqa: S310
            return dict(json.load(answer)["data"])
    except (OSError, ValueError, LookupError) as error:
        print(f"the Supervisor names no broker ({error}): write it into mqtt", file=sys.stderr)  # noqa: T201
        return dict(_USUAL)


if __name__ == "__main__":
    main()
