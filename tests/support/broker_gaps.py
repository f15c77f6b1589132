"""What cannot hold on brokers other than mosquitto, case by case, with the reason.

A case that is listed and holds all the same fails: then the list is wrong. docs/broker/others.md
says what follows for a user.
"""

_NO_FLAG = "MQTT 3.1.1: a live message does not show the retain flag, so it counts as a command"
_NO_FLAG_CASES = {
    "test_covers.py::test_a_retained_command_moves_nothing": _NO_FLAG,
}
_BLIND = "wildcards show nothing that is retained, so what an earlier bridge left is not found"

CANNOT_HOLD: dict[str, dict[str, str]] = {
    "nats": _NO_FLAG_CASES,
    "rabbitmq": {
        **_NO_FLAG_CASES,
        "test_inputs.py::test_a_count_goes_on_after_a_kill": _BLIND,
        "test_leftovers.py::test_a_change_of_the_form_leaves_one_form": _BLIND,
        "test_leftovers.py::test_a_station_that_is_gone_leaves_nothing": _BLIND,
        "test_reload.py::test_requests_are_answered": _BLIND,
        "test_two_bridges.py::test_what_one_bridge_clears_is_its_own": _BLIND,
    },
}
NOT_OF_IT: dict[str, str] = {
    "test_leftovers.py::test_a_broker_that_lets_nobody_look_gets_everything_all_the_same": (
        "an access list of mosquitto: it runs on mosquitto alone"
    ),
}
