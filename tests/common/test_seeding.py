"""Random streams by purpose."""

import subprocess
import sys

from jouleswarm.common.seeding import integer, stream


def test_a_stream_depends_on_seed_and_purpose_only() -> None:
    first = stream(1, "maml", "learn", 3).integers(2**32, size=8).tolist()
    stream(1, "maml", "learn", 4).random(100)
    assert stream(1, "maml", "learn", 3).integers(2**32, size=8).tolist() == first


def test_seeds_names_numbers_and_their_order_all_tell_streams_apart() -> None:
    purposes = [(1, "a"), (2, "a"), (1, "b"), (1, "a", 1), (1, "a", 2), (1, 1, "a"), (1, "a", "b"), (1, "b", "a")]
    assert len({tuple(stream(*each).integers(2**32, size=4).tolist()) for each in purposes}) == len(purposes)


def test_an_integer_has_31_bits() -> None:
    numbers = {integer(1, "x", index) for index in range(1000)}
    assert all(0 <= number < 2**31 for number in numbers)
    assert len(numbers) == 1000
    assert max(numbers) > 2**30


def test_another_process_draws_the_same() -> None:
    # str.__hash__ differs between processes; streams must not.
    code = "from jouleswarm.common.seeding import integer; print(integer(7, 'topology', 2))"
    answers = {subprocess.check_output([sys.executable, "-c", code], text=True) for _ in range(2)}
    assert answers == {f"{integer(7, 'topology', 2)}\n"}
