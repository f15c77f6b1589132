from soak.disturbances import Disturbances


def test_quiet_is_where_no_trouble_was() -> None:
    """Troubles of one station that overlap are one; those of another do not count."""
    found = Disturbances()
    found.begin(["s"], 10.0)
    found.begin(["s", "t"], 11.0)
    found.end(["s"], 12.0)
    found.end(["s", "t"], 13.0)
    assert found.quiet("s", 5.0, 10.0)
    assert found.quiet("s", 13.0, 20.0)
    assert not found.quiet("s", 12.5, 20.0)
    assert not found.quiet("t", 5.0, 11.5)


def test_a_trouble_that_goes_on_is_one() -> None:
    """A trouble that has not ended counts as one."""
    found = Disturbances()
    found.begin(["s"], 10.0)
    assert not found.quiet("s", 20.0, 21.0)
    assert found.longest_quiet_s("s", 8.0, 21.0) == 2.0


def test_the_longest_quiet_time_lies_between_troubles_and_new_beginnings() -> None:
    """A line that ended counts its times anew."""
    found = Disturbances()
    found.begin(["s"], 10.0)
    found.end(["s"], 12.0)
    assert found.longest_quiet_s("s", 9.0, 20.0) == 8.0
    found.began_anew(["s"], 17.0)
    assert found.longest_quiet_s("s", 9.0, 20.0) == 5.0
    assert found.anew("s", 9.0, 20.0) == [17.0]
    assert found.longest_quiet_s("t", 9.0, 20.0) == 11.0
