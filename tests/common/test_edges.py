"""A user's own graph of sidelinks: by robots, by places; and what is wrong with it, with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.edges import read_edges
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.methods.graph import directed_links, neighbourhood_of

CLUSTERS = {1: (1, 2, 3), 2: (4, 5)}
TOY = (Path(__file__).parents[2] / "scenarios" / "toy.toml").read_text()


def edges(folder: Path, text: str) -> dict[int, tuple[tuple[int, int], ...]]:
    path = folder / "edges.csv"
    path.write_text(text)
    return read_edges(path, CLUSTERS)


def test_pairs_of_robots_are_sorted_to_their_clusters(tmp_path: Path) -> None:
    found = edges(tmp_path, "# a star\n1,2\n\n3 , 1\n5,4  # the other\n1,3\n")
    assert found == {1: ((1, 2), (1, 3)), 2: ((4, 5),)}


def test_a_first_line_may_say_that_they_are_robots(tmp_path: Path) -> None:
    assert edges(tmp_path, "robot,neighbour\n1,2\n2,3\n4,5\n") == {1: ((1, 2), (2, 3)), 2: ((4, 5),)}


def test_places_are_the_same_in_every_cluster(tmp_path: Path) -> None:
    path = tmp_path / "edges.csv"
    path.write_text("\ufeffplace,neighbour\n1,3\n3,2\n")
    assert read_edges(path, {1: (1, 2, 3), 2: (7, 8, 9)}) == {1: ((1, 3), (2, 3)), 2: ((7, 9), (8, 9))}


def test_a_robot_alone_needs_no_edge(tmp_path: Path) -> None:
    (tmp_path / "edges.csv").write_text("")
    assert read_edges(tmp_path / "edges.csv", {1: (1,), 2: (2,)}) == {1: (), 2: ()}


TOLD = "expected two robots of one cluster: task 1 has 1 to 3; task 2 has 4 to 5"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1,2\n2,x\n", "line 2: got '2,x', expected two whole numbers with a comma between them"),
        ("1,2,3\n", "line 1: got '1,2,3', expected two whole numbers"),
        ("1,2\n\n2,4\n", f"line 3: got '2,4', {TOLD}"),
        ("1,1\n", f"line 1: got '1,1', {TOLD}"),
        ("1,9\n", f"line 1: got '1,9', {TOLD}"),
        (
            "place,neighbour\n1,3\n",
            "line 2: got '1,3', expected two places, from 1, of each cluster: task 1 has 1 to 3",
        ),
        ("1,2\n4,5\n", r"robots \[1, 2\] and \[3\] of task 1 are not joined, expected a way from each robot"),
        ("", r"robots \[1\] and \[2\] of task 1 are not joined"),
    ],
)
def test_a_bad_edge_is_told_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^federation\.topology {tmp_path}/edges\.csv[,:] ?.*{told}"):
        edges(tmp_path, text)


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    (tmp_path / "edges.csv").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "edges.csv", tmp_path / "nowhere.csv"):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            read_edges(path, CLUSTERS)


def test_a_scenario_s_graph_is_beside_it_and_what_is_learned_depends_on_it(tmp_path: Path) -> None:
    (tmp_path / "toy.toml").write_text(TOY)
    (tmp_path / "ours.csv").write_text("1,2\n2,3\n4,5\n5,6\n")
    settings = ['federation.topology="ours.csv"', "federation.robots_per_cluster=3"]
    scenario = load_scenario(tmp_path / "toy.toml", settings)
    assert neighbourhood_of(scenario, 5).neighbours == (4, 6)
    assert [directed_links(scenario, task) for task in (1, 2)] == [4, 4]
    assert list(scenario.files) == ["ours.csv"]
    before = scenario.determines
    (tmp_path / "ours.csv").write_text("1,2\n2,3\n4,5\n5,6\n4,6\n")
    again = load_scenario(tmp_path / "toy.toml", settings)
    assert [directed_links(again, task) for task in (1, 2)] == [4, 6]
    assert again.determines != before


@pytest.mark.parametrize(
    ("topology", "told"),
    [
        ("rnig", r"got 'rnig', expected full, ring, random, or a file of edges, NAME\.csv"),
        ("no.csv", r"scenario .*toy\.toml: federation\.topology .*no\.csv: cannot be read"),
    ],
)
def test_other_words_are_refused(tmp_path: Path, topology: str, told: str) -> None:
    (tmp_path / "toy.toml").write_text(TOY)
    with pytest.raises(ConfigurationError, match=told):
        load_scenario(tmp_path / "toy.toml", [f"federation.topology={topology}"])
