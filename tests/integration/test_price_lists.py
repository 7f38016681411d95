"""A user's own price list, from a scenario file to the bill: `jouleswarm run examples/cellular.toml`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "cellular.toml"
LABEL = "cellular, 0.9 J a message"


@pytest.fixture(scope="module")
def cellular(tmp_path_factory: pytest.TempPathFactory, starter: Any, read_run: Any) -> Any:
    out = tmp_path_factory.mktemp("cellular")
    started = starter.jouleswarm(
        "run", str(EXAMPLE), "--out", str(out), "--run-id", "cellular", "--details", COLUMNS="300"
    )
    assert started.ends() == 0, started.printed
    return read_run(out / "cellular", started.printed)


def test_its_joules_by_hand(cellular: Any) -> None:
    for arm, messages in (("maml", 2 * 6), ("fl", 0)):  # t0 rounds x motions of the one training robot
        found = cellular.summary["arms"][arm]
        assert found["bytes"]["uplink"]["messages"] == messages
        ours, its = found["energy_j"]["literal"], found["energy_j"]["cellular"]
        assert its["total"] == pytest.approx(ours["total"] + 0.9 * messages)
        assert its["ml_communication"] == pytest.approx(ours["ml_communication"] + 0.9 * messages)
        assert its["fl_communication"] == ours["fl_communication"]
        assert its["by_site"]["datacenter"] == pytest.approx(found["energy_j"]["by_site"]["datacenter"])


def test_it_has_its_column_on_the_terminal_in_the_html_and_in_the_figure(cellular: Any) -> None:
    assert f"{LABEL}: E by cause" in cellular.printed
    page = (cellular.path / "report.html").read_text()
    assert page.count(f"<th>{LABEL}</th>") == 3  # of E by each way to know it, and of each arm
    assert LABEL in (cellular.path / "figures" / "energy.svg").read_text()


def test_the_run_keeps_it(cellular: Any) -> None:
    kept = cellular.path / "doors" / "cellular.py"
    assert kept.read_bytes() == (ROOT / "examples" / "cellular.py").read_bytes()
    assert set(cellular.manifest["doors"]) == {"cellular.py"}


def test_it_is_priced_again_with_any_constant(cellular: Any, starter: Any) -> None:
    only = ["--set", 'energy.prices=["cellular:Cellular"]', "--set", "energy.p0_w=1180", "--ul", "100"]
    report = starter.jouleswarm("report", str(cellular.path), *only, "--figures", "png,svg", COLUMNS="300")
    assert report.ends() == 0, report.printed
    assert "counted payload" not in report.printed
    literal = cellular.summary["arms"]["maml"]["energy_j"]["literal"]
    causes = cellular.summary["arms"]["maml"]["energy_j"]["by_cause"]
    # twice the power of the data center, twice the price of uplink and downlink, and 12 messages
    total = literal["total"] + causes["computing_datacenter"] + causes["uplink"] + causes["downlink"] + 10.8
    assert f"{total:.4g} J" in report.printed or f"{total / 1e3:.4g} kJ" in report.printed
    assert (cellular.path / "report-ul100-prices-cellular-Cellular-p0-w1180.html").exists()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("energy.t0_batch_s=0", "energy.t0_batch_s: Input should be greater than or equal to 0"),
        ("energy.prices=['cellular:Wired']", "price list 'cellular:Wired': "),
        ("meta.t0=9", "--set meta.t0=9: expected energy.KEY=VALUE; anything else needs another run"),
    ],
)
def test_what_is_no_price_is_one_line(cellular: Any, starter: Any, change: str, says: str) -> None:
    report = starter.jouleswarm("report", str(cellular.path), "--set", change)
    assert report.ends() == 2
    (line,) = report.printed.splitlines()
    assert says in line


def test_a_list_that_fails_ends_a_command_before_anything_is_started(tmp_path: Path, starter: Any) -> None:
    (tmp_path / "cellular.py").write_text(
        "class Cellular:\n    name = label = 'x'\n    def price(self, facts, energy): 1 / 0\n"
    )
    scenario = tmp_path / "mine.toml"
    scenario.write_text(EXAMPLE.read_text())
    run = starter.jouleswarm("run", str(scenario), "--out", str(tmp_path / "runs"))
    assert run.ends() == 2
    (line,) = run.printed.splitlines()
    assert line == (
        "jouleswarm run: price list 'cellular:Cellular': price() fails on made-up facts: "
        "ZeroDivisionError: division by zero (line 3)"
    )
    assert not (tmp_path / "runs").exists()


def test_the_summary_is_plain_json(cellular: Any) -> None:
    assert json.loads((cellular.path / "summary.json").read_text())["status"] == "complete"
