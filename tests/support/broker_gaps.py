"""What cannot hold on brokers other than mosquitto, case by case, with the reason.

A case that is listed and holds all the same fails: then the list is wrong. docs/broker/others.md
says what follows for a user.
"""

_NO_FLAG = "MQTT 3.1.1: a live message does not show the retain flag, so it counts as a command"
_OF_MOSQUITTO = "an access list of mosquitto: it runs on mosquitto alone"

CANNOT_HOLD: dict[str, dict[str, str]] = {
    "nats": {
        "test_covers.py::test_a_retained_command_moves_nothing": _NO_FLAG,
        "test_line_errands.py::test_requests_that_make_no_sense_are_refused": _NO_FLAG,
    },
    "rabbitmq": {},
}
NOT_OF_IT: dict[str, str] = {
    "test_leftovers.py::test_a_broker_that_lets_nobody_look_gets_everything_all_the_same": (
        _OF_MOSQUITTO
    ),
}
