"""A message that ends connection after connection is found; faults that pass are none."""

from jouleswarm.common.bus.suspects import CONNECTIONS, SOON_S, Suspects


def connection(
    suspects: Suspects, *begun: int | str, acknowledged: tuple[int, ...] = (), after_s: float = 0.0
) -> object:
    """One connection that the broker closes, after all in `begun` was written whole at 0 s."""
    suspects.connecting()
    for key in begun:
        suspects.begun(key, f"topic-{key}", 100 + len(str(key)))
        suspects.written(key, 0.0)
    for packet_id in acknowledged:
        suspects.confirmed(packet_id)
    return suspects.lost(after_s)


def test_the_message_that_is_under_way_at_the_end_of_so_many_connections_is_not_taken() -> None:
    suspects = Suspects()
    ends = [connection(suspects, 7, 8) if number == 0 else connection(suspects, 7) for number in range(CONNECTIONS)]
    assert ends[:-1] == [None] * (CONNECTIONS - 1)
    assert ends[-1].topic == "topic-7"


def test_of_several_that_are_always_under_way_it_is_the_largest() -> None:
    suspects = Suspects()
    for _ in range(CONNECTIONS - 1):
        assert connection(suspects, 1, 1000, 2) is None
    assert connection(suspects, 1, 1000, 2).topic == "topic-1000"


def test_a_message_that_comes_through_at_last_was_only_unlucky() -> None:
    suspects = Suspects()
    for _ in range(CONNECTIONS - 1):
        connection(suspects, 1, 2)
    assert connection(suspects, 1, 2, acknowledged=(1, 2)) is None
    for _ in range(CONNECTIONS - 1):  # another message under the same identifier begins anew
        assert connection(suspects, 1) is None


def test_progress_on_every_connection_is_no_refusal() -> None:
    suspects = Suspects()
    for number in range(10 * CONNECTIONS):
        assert connection(suspects, number, number + 1, acknowledged=(number,)) is None


def test_connections_without_messages_and_those_that_end_otherwise_begin_anew() -> None:
    suspects = Suspects()
    for end in ("nothing under way", "not closed by the broker"):
        for _ in range(CONNECTIONS - 1):
            assert connection(suspects, 1) is None
        if end == "nothing under way":
            assert connection(suspects) is None
        else:
            suspects.connecting()
            suspects.begun(1, "topic-1", 100)
            suspects.connecting()
    assert connection(suspects, 1) is None


def test_at_qos_0_the_topic_is_suspected_while_its_message_has_just_been_sent() -> None:
    suspects = Suspects()
    for _ in range(CONNECTIONS - 1):
        assert connection(suspects, "weights") is None
    assert connection(suspects, "weights").topic == "topic-weights"
    for _ in range(2 * CONNECTIONS):  # the connection went on for a while: it was read
        assert connection(suspects, "weights", after_s=2 * SOON_S) is None
    for _ in range(2 * CONNECTIONS):  # what was sent after it has been acknowledged
        assert connection(suspects, "weights", 1, acknowledged=(1,)) is None
