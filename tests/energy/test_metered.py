"""Files of several meters as one experiment: names, both ends of a link, what was measured."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from jouleswarm import Meter
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.energy.named import with_numbers
from jouleswarm.energy.rows import read_rows
from jouleswarm.report.calculated import calculate, document


def numbers(*names: object) -> list[object]:
    return [row["robot"] for row in with_numbers([{"robot": name} for name in names])]


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["client-3", "client-12", "client-3"], [3, 12, 3]),
        (["client-3", "4", 5, "datacenter"], [3, "4", 5, "datacenter"]),
        (["client-0", "client-10", "client-2"], [1, 3, 2]),  # 0 is the data center's
        (["a-1", "b-1"], [1, 2]),
        (["zoe", "ann"], [2, 1]),
        (["node-1234567", "node-7"], [1, 2]),  # more digits than a robot's number has
    ],
)
def test_names_become_numbers(names: list[object], found: list[object]) -> None:
    assert numbers(*names) == found


@given(st.lists(st.text("ab01", min_size=1).filter(lambda name: any(map(str.isalpha, name))), min_size=1))
def test_each_name_has_a_number_of_its_own_from_1_on(names: list[str]) -> None:
    found = dict(zip(names, numbers(*names), strict=True))
    assert len(set(found.values())) == len(found)
    assert all(isinstance(number, int) and number >= 1 for number in found.values())


def test_names_without_numbers_beside_numbers_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="robots ann and 3: by name and by number"):
        numbers("ann", "3")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two clients that each send 1000 bytes up and get 500; the server counts too, but for what it sends to the second;
    on the way up a message of the first was lost."""
    server = Meter("server", "server", tmp_path / "server.csv", arm="a")
    for number in (1, 2):
        client = Meter(f"c-{number}", file=tmp_path / f"{number}.csv", arm="a")
        with client.phase("train", round=1):
            client.gradients(10)
        client.sent("uplink", 1000)
        if number == 1:
            client.sent("uplink", 1000)
            server.sent("downlink", 500, to="c-1")
        client.received("downlink", 500)
        server.received("uplink", 1000, sender=f"c-{number}")
        client.flush()
    server.gradients(4)
    server.flush()
    return tmp_path


def test_what_both_ends_count_counts_once_as_the_receiver_has_it(folder: Path) -> None:
    (facts,) = calculate(folder).facts.values()
    assert (facts.counts.fl.uplink_bytes, facts.counts.fl.downlink_bytes) == (2000, 1000)
    assert sorted((flow.sender, flow.receiver, flow.messages) for flow in facts.flows) == [
        ("agent-1", "datacenter", 1), ("agent-2", "datacenter", 1), ("datacenter", "agent-1", 1),
        ("datacenter", "agent-2", 1),
    ]  # fmt: skip
    only = calculate([folder / "1.csv"]).facts["a"]
    assert only.counts.fl.uplink_bytes == 2000  # nobody says what was received


def test_files_one_by_one_are_the_folder_and_constants_are_by_robot(folder: Path) -> None:
    files = sorted(folder.glob("*.csv"))
    assert [row.value for row in read_rows(files)] == [row.value for row in read_rows(folder)]
    (folder / "my.toml").write_text("[energy]\n[[robots]]\nid = 2\npk_w = 10.2\n")
    (arm,) = document(calculate(files, folder / "my.toml"))["arms"].values()
    causes = arm["energy_j"]["literal"]["by_cause"]
    assert causes["computing_robots"] == pytest.approx(10 * 0.4 * (5.1 + 10.2))
    assert causes["computing_datacenter"] == pytest.approx(4 * 0.02 * 590 * 1.67)


def test_rounds_are_those_told_or_else_those_of_the_labels_and_counted_once() -> None:
    rows = [
        {"robot": f"c-{robot}", "what": what, "value": 10, "round": number}
        for robot, last in ((1, 3), (2, 2))
        for number in range(1, last + 1)
        for what in ("gradients", "motions")
    ]
    (facts,) = calculate(rows).facts.values()
    assert facts.rounds == {1: 3}
    assert [(work.robot, work.plain, work.motions, work.rounds) for work in facts.work] == [
        (1, 30, 30, 3),
        (2, 20, 20, 3),
    ]
    (told,) = calculate([*rows, {"what": "rounds", "value": 7}]).facts.values()
    assert (told.rounds, [work.rounds for work in told.work]) == ({1: 7}, [7, 7])


def test_what_was_measured_stands_beside_the_bill_and_not_in_it(folder: Path) -> None:
    found = document(calculate(folder))
    places = {(each["arm"], each["site"], each["activity"]) for each in found["measured"]}
    assert places == {("a", "robots", ""), ("a", "robots", "train"), ("a", "datacenter", "")}
    counted = [row.model_dump(exclude={"where"}) for row in read_rows(folder) if row.what.endswith(("_bytes", "ients"))]
    assert document(calculate(counted))["arms"]["a"]["energy_j"] == found["arms"]["a"]["energy_j"]
    assert "measured" not in document(calculate(counted))


def test_a_folder_without_files_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="no rows, expected some"):
        calculate(tmp_path)
    with pytest.raises(ConfigurationError, match="row 1: got int, expected a row of what and value"):
        calculate([3])
