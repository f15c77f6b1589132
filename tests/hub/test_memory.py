from bridge.hub.memory import Loss


def test_a_loss_begins_and_ends_once() -> None:
    """Only the change counts, and the loss keeps the instant of its begin."""
    loss = Loss()
    assert not loss.turn(away=False, now=1.0)
    assert loss.turn(away=True, now=2.0)
    assert not loss.turn(away=True, now=3.0)
    assert loss.since == 2.0
    assert loss.turn(away=False, now=4.0)
    assert loss.since is None


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
