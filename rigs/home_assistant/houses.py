"""The configurations of the tests: lines as YAML, with `{directory}` for where their ports are."""

# Every kind of entity, on four stations of two lines, and a rule; `north-wing_2` has each character
# of an id.
EVERYTHING = """\
- id: main
  port: "{directory}/main"
  baud: 19200
  protocol: wisco
  stations:
    - address: 1
      model: DIO100
      id: garage
      name: Garage ä
      area: Yard
      inputs:
        1: {name: Door, device_class: door}
        2: {name: Motion, device_class: motion, invert: true}
        3: {name: Button, gestures: true}
        4: {name: Water meter, count: {unit: L, factor: 0.5, device_class: water}}
        5: false
      outputs:
        1: {name: Lamp, as: light}
        2: {name: Gate, mode: pulse, hold: 0.5s}
        3: {name: Boiler, read_only: true}
        4: {name: Pump, max_on: 10min, on_loss: {after: 10min, state: "OFF"}}
        5: {name: Water, as: valve}
        6: {name: Cabinet, as: lock}
        7: {name: Alarm, as: siren}
        8: {name: Fan, as: fan, mode: latch}
    - {address: 2, model: DO100, id: cellar, name: Cellar}
- id: annex
  port: "{directory}/annex"
  baud: 19200
  protocol: modbus-rtu
  stations:
    - address: 1
      model: DIO100
      id: north-wing_2
      name: North wing
      area: Annex
      outputs: {3: {name: Timer, max_on: 3s}}
    - address: 2
      model: DO100
      covers:
        shutter:
          {name: Shutter, open: 1, close: 2, open_time: 3s, close_time: 2s, device_class: shutter}
rules:
- {name: Corridor, when: north-wing_2/di/9, is: ON, then: {north-wing_2/do/5: TOGGLE}}
"""
# Two of each model, of which the configuration names nothing.
DEFAULTS = """\
- id: main
  port: "{directory}/main"
  protocol: wisco
  baud: 19200
  stations:
    - {address: 1, model: DIO100}
    - {address: 2, model: DO100}
    - {address: 3, model: DIO100}
    - {address: 4, model: DO100}
"""


def many(stations: int = 32) -> str:
    """DIO100s of 24 channels each, one line for every eight."""
    return "".join(_line(first) for first in range(0, stations, 8))


def _line(first: int) -> str:
    stations = "".join(
        f"    - {{address: {n}, model: DIO100, id: station_{first + n}}}\n" for n in range(1, 9)
    )
    head = f'- id: line_{first // 8}\n  port: "{{directory}}/line_{first // 8}"\n'
    return f"{head}  baud: 57600\n  protocol: modbus-rtu\n  stations:\n{stations}"


# Four DO100s on a slow line: a scene of 64 outputs.
RELAYS = """\
- id: main
  port: "{directory}/main"
  baud: 9600
  protocol: wisco
  stations:
    - {address: 1, model: DO100}
    - {address: 2, model: DO100}
    - {address: 3, model: DO100}
    - {address: 4, model: DO100}
"""
