"""Counters that outlive the process that counts."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from jouleswarm.common.errors import RunError
from jouleswarm.common.meter.cells import Key
from jouleswarm.common.meter.counters import Counters, read_counters

ROOT = Path(__file__).parents[2]
A, B, C = (("agent-1", f"topic/{name}", "in") for name in "abc")


def add(counters: Counters, key: Key, messages: int, payload_bytes: int, packet_bytes: int) -> None:
    counters.cell(key).add(payload_bytes, packet_bytes, messages)


def test_counts_are_added_up_and_told_in_the_order_of_their_keys() -> None:
    counters = Counters()
    add(counters, B, 1, 20, 30)
    add(counters, A, 1, 5, 6)
    add(counters, B, 1, 1, 1)
    assert list(counters.items()) == [(A, (1, 5, 6)), (B, (2, 21, 31))]
    counters.flush()


def test_the_next_process_with_a_folder_goes_on_counting(tmp_path: Path) -> None:
    first = Counters(tmp_path / "deep")
    add(first, B, 1, 20, 30)
    add(first, A, 2, 2**40, 2**62)
    second = Counters(tmp_path / "deep")
    add(second, A, 1, 1, 1)
    add(second, C, 7, 7, 7)
    third = Counters(tmp_path / "deep")
    assert list(third.items()) == [(A, (3, 2**40 + 1, 2**62 + 1)), (B, (1, 20, 30)), (C, (7, 7, 7))]
    assert read_counters(tmp_path / "deep") == dict(third.items())


def test_counts_of_a_process_that_lives_are_read_from_outside(tmp_path: Path) -> None:
    living = Counters(tmp_path)
    add(living, A, 1, 1, 1)
    assert read_counters(tmp_path) == {A: (1, 1, 1)}
    add(living, A, 1, 1, 1)
    assert read_counters(tmp_path) == {A: (2, 2, 2)}


def test_where_nobody_has_counted_nothing_is_read_and_nothing_made(tmp_path: Path) -> None:
    assert read_counters(tmp_path / "nowhere") == {}
    assert list(tmp_path.iterdir()) == []


def test_a_torn_last_key_is_cut_off_and_its_cell_used_again(tmp_path: Path) -> None:
    first = Counters(tmp_path)
    add(first, A, 1, 1, 1)
    with (tmp_path / "counters.keys").open("ab") as keys:
        keys.write(b'["agent-1", "top')  # killed while it wrote the key, before it counted
    assert read_counters(tmp_path) == {A: (1, 1, 1)}
    second = Counters(tmp_path)
    add(second, B, 5, 5, 5)
    expected = {A: (1, 1, 1), B: (5, 5, 5)}
    assert dict(Counters(tmp_path).items()) == expected
    assert read_counters(tmp_path) == expected
    assert (tmp_path / "counters.keys").read_bytes().count(b"\n") == 2


def test_there_is_room_for_more_keys_than_a_file_holds(tmp_path: Path) -> None:
    keys = [("agent-1", f"topic/{number:04d}", "in") for number in range(4096 + 2)]
    first = Counters(tmp_path)
    for number, key in enumerate(keys):
        add(first, key, 1, number, 2 * number)
    assert len(list(tmp_path.glob("counters-*.bin"))) == 2
    expected = {key: (1, number, 2 * number) for number, key in enumerate(keys)}
    assert dict(Counters(tmp_path).items()) == expected
    assert read_counters(tmp_path) == expected


def test_counts_survive_a_kill_in_the_middle_of_counting(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from jouleswarm.common.meter.counters import Counters\n"
        "counters = Counters(Path(sys.argv[1]))\n"
        "while True:\n"
        "    cell = counters.cell(('agent-1', 'topic/a', 'in'))\n"
        "    cell.add(10, 20)\n"
        "    print(cell.messages, flush=True)\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path)]
    said = 0
    for _ in range(2):  # the second goes on from the first
        with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            lines = [int(child.stdout.readline()) for _ in range(50)]
            assert lines == list(range(lines[0], lines[0] + 50))
            assert lines[0] > said
            child.kill()
            rest = child.stdout.read().splitlines(keepends=True)
            said = max([lines[-1], *(int(line) for line in rest if line.endswith("\n"))])
        messages, payload, packet = read_counters(tmp_path)[A]
        assert said <= messages <= said + 1
        assert (payload, packet) == (10 * messages, 20 * messages)  # all three, or none


class Killed(BaseException):
    """In place of a kill -9."""


class Mortal:
    """A cell's numbers, of which only so many more are written."""

    def __init__(self, numbers: memoryview, left: int) -> None:
        self._numbers, self._left = numbers, left

    def __getitem__(self, place: int) -> int:
        return int(self._numbers[place])

    def __setitem__(self, place: int, number: int) -> None:
        if not self._left:
            raise Killed
        self._left -= 1
        self._numbers[place] = number


@pytest.mark.parametrize("written", range(6))
def test_a_kill_at_any_moment_of_counting_leaves_all_three_counts_or_none(written: int, tmp_path: Path) -> None:
    counters = Counters(tmp_path)
    add(counters, A, 1, 10, 20)
    cell: Any = counters.cell(A)
    cell._numbers = Mortal(cell._numbers, written)
    with contextlib.suppress(Killed):
        cell.add(5, 7)
    expected = (2, 15, 27) if written == 5 else (1, 10, 20)
    assert read_counters(tmp_path) == {A: expected}
    again = Counters(tmp_path)
    for _ in range(2):
        add(again, A, 1, 1, 1)
    assert read_counters(tmp_path) == {A: (expected[0] + 2, expected[1] + 2, expected[2] + 2)}


def test_what_is_announced_is_in_the_file_at_once_and_in_the_counter_when_it_happened(tmp_path: Path) -> None:
    counters = Counters(tmp_path)
    add(counters, A, 1, 10, 20)
    cell = counters.cell(A)
    cell.announce(5, 7)
    cell.announce(5, 7)
    assert read_counters(tmp_path) == {A: (3, 20, 34)}
    assert cell.counts == (1, 10, 20)
    cell.add(5, 7)
    cell.add(5, 7)
    assert cell.counts == (3, 20, 34)
    assert read_counters(tmp_path) == {A: (3, 20, 34)}
    cell.add(1, 1)
    assert read_counters(tmp_path) == {A: (4, 21, 35)}


def test_what_counts_no_message_is_in_the_file_too(tmp_path: Path) -> None:
    counters = Counters(tmp_path)
    add(counters, A, 0, 3, 4)
    assert read_counters(tmp_path) == {A: (0, 3, 4)}
    add(counters, A, 1, 1, 1)
    add(counters, A, 0, 1, 1)
    assert read_counters(tmp_path) == {A: (1, 5, 6)}


def test_nothing_added_leaves_the_newest_counts_where_a_torn_write_does_not_reach_them(tmp_path: Path) -> None:
    first = Counters(tmp_path)
    for _ in range(2):
        add(first, A, 1, 10, 20)
    again = Counters(tmp_path)
    add(again, A, 0, 0, 0)
    cell: Any = again.cell(A)
    cell._numbers = Mortal(cell._numbers, 2)
    with contextlib.suppress(Killed):
        cell.add(5, 7)
    assert read_counters(tmp_path) == {A: (2, 20, 40)}


def test_what_was_announced_and_did_not_happen_is_taken_back(tmp_path: Path) -> None:
    counters = Counters(tmp_path)
    cell = counters.cell(A)
    for _ in range(3):
        cell.announce(5, 7)
    cell.add(5, 7)
    cell.withdraw()
    cell.withdraw()
    assert cell.counts == (1, 5, 7)
    assert read_counters(tmp_path) == {A: (1, 5, 7)}
    cell.announce(5, 7)
    assert read_counters(tmp_path) == {A: (2, 10, 14)}
    assert dict(Counters(tmp_path).items()) == {A: (2, 10, 14)}  # so does who goes on from a kill here
    cell.withdraw()
    cell.add(1, 1)
    assert read_counters(tmp_path) == {A: (2, 6, 8)}


@pytest.mark.parametrize("written", range(25))
def test_a_kill_at_any_moment_leaves_what_happened_and_no_more_than_was_announced(written: int, tmp_path: Path) -> None:
    counters = Counters(tmp_path)
    cell: Any = counters.cell(A)
    cell._numbers = Mortal(cell._numbers, written)
    happened = announced = 0
    with contextlib.suppress(Killed):
        for fails in (False, True, False):
            cell.announce(5, 7)
            cell.announce(5, 7)
            announced += 2  # told when the call is over: only then has anybody else the message
            happened += 1
            cell.add(5, 7)
            if fails:
                cell.withdraw()
                announced = happened
            else:
                happened += 1
                cell.add(5, 7)
    messages, payload, packet = read_counters(tmp_path).get(A, (0, 0, 0))
    assert happened <= messages <= announced + 2
    assert (payload, packet) == (5 * messages, 7 * messages)


def counted(folder: Path) -> Path:
    counters = Counters(folder)
    for key in (A, B):
        for _ in range(2):  # both places of each cell have been written
            add(counters, key, 1, 10, 20)
    return folder / "counters-0.bin"


@pytest.mark.parametrize("bit", range(0, 8 * 128, 7))
def test_a_counter_of_which_a_bit_has_turned_is_refused_by_name(bit: int, tmp_path: Path) -> None:
    file = counted(tmp_path)
    content = bytearray(file.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    file.write_bytes(content)
    with pytest.raises(RunError, match=rf"{file}: not as it was written .*topic/{'ab'[bit // 512]}"):
        Counters(tmp_path)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "counters of zeros": lambda folder: (folder / "counters-0.bin").write_bytes(bytes(4096 * 64)),
    "counters cut short": lambda folder: (folder / "counters-0.bin").write_bytes(b"1234567"),
    "counters gone": lambda folder: (folder / "counters-0.bin").unlink(),
    "keys gone": lambda folder: (folder / "counters.keys").unlink(),
    "a key gone": lambda folder: (folder / "counters.keys").write_text(json.dumps(A) + "\n"),
    "keys in another order": lambda folder: (folder / "counters.keys").write_text(
        f"{json.dumps(B)}\n{json.dumps(A)}\n"
    ),
    "keys that are none": lambda folder: (folder / "counters.keys").write_text("?\n?\n"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_counters_that_are_not_as_they_were_written_are_refused(damage: str, tmp_path: Path) -> None:
    counted(tmp_path)
    DAMAGES[damage](tmp_path)
    for reader in (Counters, read_counters):
        with pytest.raises(RunError, match=f"^{tmp_path}/counters.*begin the run anew$"):
            reader(tmp_path)


def test_a_file_that_was_being_made_is_made_again(tmp_path: Path) -> None:
    (tmp_path / "counters-0.bin").touch()  # killed before its place on the disk was taken
    add(Counters(tmp_path), A, 1, 2, 3)
    assert read_counters(tmp_path) == {A: (1, 2, 3)}


def test_counters_have_their_place_on_the_disk_before_they_are_counted_in(tmp_path: Path) -> None:
    add(Counters(tmp_path), A, 1, 2, 3)
    assert (tmp_path / "counters-0.bin").stat().st_blocks * 512 >= 4096 * 64


@pytest.mark.parametrize("name", ["a topic/with ünicode", 'quote"d', "line\nbreak"])
def test_any_name_can_be_a_key(name: str, tmp_path: Path) -> None:
    add(Counters(tmp_path), (name, name, "in"), 1, 2, 3)
    assert read_counters(tmp_path) == {(name, name, "in"): (1, 2, 3)}


def test_forgotten_cells_are_gone_and_what_comes_after_is_counted_right(tmp_path: Path) -> None:
    for folder in (None, tmp_path):
        counters = Counters(folder)
        for key in (A, B, C):
            add(counters, key, 1, 20, 30)
        counters.forget("topic/b")
        assert list(counters.items()) == [(A, (1, 20, 30)), (C, (1, 20, 30))]
        assert (len(counters), B in counters) == (2, False)
        add(counters, ("agent-1", "topic/d", "in"), 4, 4, 4)
        add(counters, B, 7, 7, 7)
        assert [cell for _, cell in counters.items()] == [(1, 20, 30), (7, 7, 7), (1, 20, 30), (4, 4, 4)]
    counters.forget("topic/c")
    again = Counters(tmp_path)
    assert [key[1] for key, _ in again.items()] == ["topic/a", "topic/b", "topic/d"]
    assert list(again.items("topic/b")) == [(B, (7, 7, 7))]
    assert {key: cell for key, cell in read_counters(tmp_path).items() if any(cell)} == dict(again.items())
