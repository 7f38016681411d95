"""What a process goes on from: exact, whole or not at all, and nobody else's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from jouleswarm.common.disk.files import write_whole
from jouleswarm.common.disk.seals import Growing, Seal
from jouleswarm.common.disk.state import State, generator_state, load_generator
from jouleswarm.common.disk.statefile import StateFile
from jouleswarm.common.errors import RunError

OWNER = "robot 1 of run r"


def saved_and_loaded(state: State, folder: Path) -> State:
    StateFile(folder / "s.safetensors", OWNER).save(state)
    found = StateFile(folder / "s.safetensors", OWNER).load()
    assert found is not None
    return found


def assert_same(ours: State, theirs: State) -> None:
    assert ours.values == theirs.values
    assert list(ours.arrays) == list(theirs.arrays)  # codecs lay tensors end to end in this order
    for name, array in ours.arrays.items():
        other = theirs.arrays[name]
        assert (array.shape, array.dtype) == (other.shape, other.dtype)
        assert array.tobytes() == other.tobytes()


def test_parts_are_put_together_and_taken_out_again() -> None:
    parts = {
        "a": State({"x": np.arange(3), "deep/y": np.ones(2)}, {"n": 1}),
        "a2": State({"x": np.zeros(1)}),  # its name begins as the other's
        "empty": State(),
    }
    whole = State.of(parts)
    assert sorted(whole.arrays) == ["a/deep/y", "a/x", "a2/x"]
    assert whole.values == {"a": {"n": 1}, "a2": {}, "empty": {}}
    for name, part in parts.items():
        assert_same(whole.part(name), part)


def test_parts_may_have_parts(tmp_path: Path) -> None:
    inner = State.of({"b": State({"x": np.arange(2)}, {"n": 1}), "c": State()})
    found = saved_and_loaded(State.of({"a": inner, "d": State()}), tmp_path)
    assert_same(found.part("a").part("b"), State({"x": np.arange(2)}, {"n": 1}))
    assert_same(found.part("a").part("c"), State())


def test_arrays_come_back_in_their_order(tmp_path: Path) -> None:
    names = [f"{number}.weight" for number in (5, 0, 11, 2, 7)]
    found = saved_and_loaded(State({name: np.ones(place + 1) for place, name in enumerate(names)}), tmp_path)
    assert list(found.arrays) == names


@pytest.mark.parametrize(
    "array",
    [
        np.array(3.5, np.float32),
        np.array(7),
        np.zeros((0, 4), np.float32),
        np.arange(6, dtype=np.float32).reshape(2, 3).T,  # not in C order
        np.arange(10, dtype=np.uint8)[::2],
        np.array([True, False]),
    ],
    ids=["0-d float", "0-d int", "empty", "transposed", "strided", "bool"],
)
def test_an_array_comes_back_as_it_was(array: Any, tmp_path: Path) -> None:
    assert_same(saved_and_loaded(State({"x": array}), tmp_path), State({"x": array}))


any_array = arrays.arrays(
    st.sampled_from([np.float32, np.float64, np.int64, np.uint8, np.bool_]), arrays.array_shapes(min_dims=0)
)
any_value = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=30, deadline=None)
@given(
    arrays=st.dictionaries(st.text("abc/é", min_size=1, max_size=5), any_array, max_size=3),
    values=st.dictionaries(st.text(max_size=5), any_value, max_size=3),
)
def test_whatever_is_saved_is_loaded_bit_by_bit(
    arrays: dict[str, Any], values: dict[str, Any], tmp_path_factory: pytest.TempPathFactory
) -> None:
    state = State(arrays, values)
    assert_same(saved_and_loaded(state, tmp_path_factory.mktemp("state")), state)


@given(value=st.floats(allow_nan=False))
@settings(max_examples=30, deadline=None)
def test_a_float_is_read_back_exactly(value: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    found = saved_and_loaded(State(values={"x": value}), tmp_path_factory.mktemp("state")).values["x"]
    assert (found, math.copysign(1, found)) == (value, math.copysign(1, value))


def test_without_a_file_there_is_no_state(tmp_path: Path) -> None:
    file = StateFile(tmp_path / "deep" / "s.safetensors", OWNER)
    assert file.load() is None
    file.save(State(values={"n": 1}))
    assert file.load() == State(values={"n": 1})


def test_another_owners_state_is_refused_and_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "s.safetensors"
    StateFile(path, OWNER).save(State(values={"n": 1}))
    with pytest.raises(RunError, match=r"it is another scenario's, run's or process's.*name another folder") as caught:
        StateFile(path, "robot 2 of run r").load()
    assert str(path.parent) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert StateFile(path, OWNER).load() == State(values={"n": 1})


class Killed(BaseException):
    """In place of a kill -9."""


def dies(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """From here on a process is killed when it has written so much of a state's content."""

    def write(file: Any, content: bytes) -> None:
        file.write(content[: int(share * len(content))])
        raise Killed

    monkeypatch.setattr("jouleswarm.common.disk.statefile._write_all", write)


@pytest.mark.parametrize("share", [0, 0.5, 1])
@pytest.mark.parametrize("saved", range(5))
def test_a_write_that_was_cut_short_leaves_the_state_before_it(
    saved: int, share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = StateFile(tmp_path / "s", OWNER)
    for round_ in range(1, saved + 1):
        file.save(State({"x": np.arange(100 + round_)}, {"round": round_}))
    with monkeypatch.context() as patch:
        dies(patch, share)
        with pytest.raises(Killed):
            file.save(State({"x": np.arange(300)}, {"round": saved + 1}))
    again = StateFile(tmp_path / "s", OWNER)
    found = again.load()
    if saved:
        assert_same(found or State(), State({"x": np.arange(100 + saved)}, {"round": saved}))
    else:
        assert found is None
    for round_ in (7, 8, 9):
        again.save(State(values={"round": round_}))
        assert StateFile(tmp_path / "s", OWNER).load() == State(values={"round": round_})


@pytest.mark.parametrize("saved", range(5))
def test_a_state_is_torn_as_a_kill_in_the_middle_of_the_next_write_leaves_it(
    saved: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("killed", "torn"):
        file = StateFile(tmp_path / name, OWNER)
        for round_ in range(1, saved + 1):
            file.save(State({"x": np.arange(100)}, {"round": round_}))
    with monkeypatch.context() as patch:
        dies(patch, 0.5)
        with pytest.raises(Killed):
            StateFile(tmp_path / "killed", OWNER).save(State({"x": np.arange(100)}, {"round": saved + 1}))
    StateFile(tmp_path / "torn", None).tear()
    for number in (0, 1):
        killed, torn = ((tmp_path / f"{name}.{number}").read_bytes() for name in ("killed", "torn"))
        assert torn[:16] == killed[:16]  # whether it is whole, and the number of the write
    found = StateFile(tmp_path / "torn", OWNER).load()
    assert (found.values if found else None) == ({"round": saved} if saved else None)


DAMAGES = {
    "cut off": lambda whole: whole[:-1],
    "empty": lambda whole: b"",
    "of zeros": lambda whole: bytes(len(whole)),
    "garbage": lambda whole: b"?" * 100,
    "a bit turned": lambda whole: whole[:-1] + bytes([whole[-1] ^ 1]),
    "a bit of its number turned": lambda whole: whole[:8] + bytes([whole[8] ^ 2]) + whole[9:],
}


@pytest.mark.parametrize("damage", [*DAMAGES, "gone"])
@pytest.mark.parametrize("saved", [2, 3, 4])
def test_a_newest_state_that_was_damaged_is_refused_and_not_the_one_before_taken(
    saved: int, damage: str, tmp_path: Path
) -> None:
    file = StateFile(tmp_path / "s", OWNER)
    for round_ in range(1, saved + 1):
        file.save(State({"x": np.arange(100)}, {"round": round_}))
    newest = tmp_path / f"s.{(saved + 1) % 2}"
    if damage == "gone":
        newest.unlink()
    else:
        newest.write_bytes(DAMAGES[damage](newest.read_bytes()))
    with pytest.raises(RunError, match=f"^state {newest}: (gone|not as it was written)"):
        StateFile(tmp_path / "s", OWNER).load()


def test_an_older_state_that_was_damaged_is_not_needed(tmp_path: Path) -> None:
    file = StateFile(tmp_path / "s", OWNER)
    for round_ in (1, 2, 3):
        file.save(State({"x": np.arange(100)}, {"round": round_}))
    older = tmp_path / "s.1"
    older.write_bytes(older.read_bytes()[:-1])
    assert_same(StateFile(tmp_path / "s", OWNER).load() or State(), State({"x": np.arange(100)}, {"round": 3}))


def test_a_first_write_that_was_cut_short_before_there_were_two_files_has_saved_nothing(tmp_path: Path) -> None:
    (tmp_path / "s.1").touch()
    assert StateFile(tmp_path / "s", OWNER).load() is None
    StateFile(tmp_path / "s", OWNER).save(State(values={"round": 1}))
    (tmp_path / "s.0").write_bytes(b"")
    assert StateFile(tmp_path / "s", OWNER).load() is None


def test_a_first_state_that_was_damaged_is_refused(tmp_path: Path) -> None:
    StateFile(tmp_path / "s", OWNER).save(State(values={"round": 1}))
    file = tmp_path / "s.0"
    file.write_bytes(file.read_bytes()[:-1])
    with pytest.raises(RunError, match=f"state {file}: not as it was written"):
        StateFile(tmp_path / "s", OWNER).load()


def test_a_state_is_refused_if_a_file_that_it_relies_on_is_not_as_it_was(tmp_path: Path) -> None:
    beside = tmp_path / "rows"
    beside.write_bytes(b"one\ntwo\n")
    growing = Growing(beside)
    parts = {"a": State(values={}), "b": State(files={"rows": growing.seal()})}
    StateFile(tmp_path / "s", OWNER).save(State.of(parts))
    with beside.open("ab") as file:
        file.write(b"three\n")  # after the state
    found = StateFile(tmp_path / "s", OWNER).load()
    assert found is not None
    assert found.part("a").files["rows"].is_like(Seal.of(b"one\ntwo\n"))
    assert growing.seal().is_like(Seal.of(b"one\ntwo\nthree\n"))
    for content, why in ((b"one\ntwO\nthree\n", "altered"), (b"one\n", "cut short to 4 bytes")):
        beside.write_bytes(content)
        with pytest.raises(RunError, match=rf"^{beside}: not as it was written \({why}"):
            StateFile(tmp_path / "s", OWNER).load()
    beside.unlink()
    with pytest.raises(RunError, match=rf"^{beside}: not as it was written \(No such file"):
        StateFile(tmp_path / "s", OWNER).load()


def test_a_shorter_state_is_not_read_together_with_the_end_of_a_longer_one(tmp_path: Path) -> None:
    file = StateFile(tmp_path / "s", OWNER)
    for size in (1000, 1000, 10):
        file.save(State({"x": np.arange(size)}))
    assert_same(file.load() or State(), State({"x": np.arange(10)}))


@pytest.mark.parametrize("durable", [False, True])
def test_a_durable_state_is_the_same_state(durable: bool, tmp_path: Path) -> None:
    frames = tmp_path / "frames.bin"
    frames.write_bytes(b"frames")
    StateFile(tmp_path / "s", OWNER, durable=durable).save(State(values={"n": 1}))
    assert StateFile(tmp_path / "s", OWNER).load() == State(values={"n": 1})


def test_a_file_that_cannot_be_replaced_stays_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "s"
    write_whole(path, b"old")
    path.with_name("s.part").mkdir()
    with pytest.raises(RunError, match=f"cannot write {path}: "):
        write_whole(path, b"new")
    assert path.read_bytes() == b"old"


def test_a_random_generator_goes_on_where_another_was(tmp_path: Path) -> None:
    rng, other = np.random.default_rng(1), np.random.default_rng(2)
    rng.integers(3, size=5, dtype=np.uint8)  # leaves half a draw in its buffer
    load_generator(other, saved_and_loaded(State(values={"rng": generator_state(rng)}), tmp_path).values["rng"])
    assert other.integers(3, size=50, dtype=np.uint8).tolist() == rng.integers(3, size=50, dtype=np.uint8).tolist()
    assert other.random(5).tolist() == rng.random(5).tolist()
