"""Counters that outlive the process that counts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from common.counters import Counters, Key, read_counters

ROOT = Path(__file__).parents[2]
A, B, C = (("agent-1", f"topic/{name}", "in") for name in "abc")


def add(counters: Counters, key: Key, *amounts: int) -> None:
    cell = counters.cell(key)
    for place, amount in enumerate(amounts):
        cell[place] += amount


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
        "import sys; from pathlib import Path; from common.counters import Counters\n"
        "counters = Counters(Path(sys.argv[1]))\n"
        "while True:\n"
        "    cell = counters.cell(('agent-1', 'topic/a', 'in'))\n"
        "    cell[0] += 1; cell[1] += 10; cell[2] += 20\n"
        "    print(cell[0], flush=True)\n"
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
        # A kill between two of the three additions leaves the later ones out, once a life.
        assert 10 * (messages - 2) <= payload <= 10 * messages
        assert 20 * (messages - 2) <= packet <= 2 * payload


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
