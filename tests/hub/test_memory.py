from bridge.hub.memory import Loss


def test_what_was_done_is_forgotten_with_the_loss() -> None:
    """An order counts for the loss in which it was made, and for no other."""
    loss = Loss()
    loss.carried_out("garage", 1)
    loss.turn(away=True, now=2.0)
    assert loss.done == frozenset()
    loss.carried_out("garage", 1)
    assert loss.done == {("garage", 1)}
    loss.turn(away=False, now=3.0)
    loss.turn(away=True, now=4.0)
    assert loss.done == frozenset()
