"""What the page shows of a meter: numbers worked out by hand from packets that are made up."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import pytest

from jouleswarm.metering.metered import load_metered
from jouleswarm.page import prices
from jouleswarm.page.meter.charts import clients_chart, links_chart, time_chart
from jouleswarm.page.meter.drawing import around, meter_svg
from jouleswarm.page.meter.model import MeterShown, meter_priced
from jouleswarm.page.meter.source import MeterFolder
from jouleswarm.page.meter.words import busiest_table, meter_heading, total_section
from jouleswarm.report.sliders import LINK_SLIDERS
from tests.made_up_meter import BEGAN_S, MadeUpMeter, Packet

LINKS = """
"up" = { link = "uplink" }
"model" = { link = "downlink" }
"peer/+sender" = { link = "sidelink" }
"state/#" = { link = "control" }
"""
FIRST: list[Packet] = [("r1", "up", "in", 1000), ("server", "up", "out", 1000), ("r1", "peer/r1", "in", 500)]
SECOND: list[Packet] = [
    *(("r1", "up", "in", 1000), ("server", "up", "out", 1000), ("r2", "peer/r1", "out", 500)),
    *(("r1", "model", "out", 4000), ("r2", "model", "out", 4000), ("r2", "state/x", "in", 70)),
]
AT_REST = {each.key: 0.0 for each in LINK_SLIDERS}
HOSTILE = "<script>alert(1)</script>&{a}"


def look(path: Path) -> MeterShown:
    found = MeterFolder(path).look()
    assert found is not None
    return found


@pytest.fixture
def shown(tmp_path: Path) -> MeterShown:
    with MadeUpMeter(tmp_path / "mine", LINKS) as meter:
        meter.pass_by(0, FIRST)
        meter.pass_by(2, SECOND)
    return look(tmp_path / "mine")


def test_a_meters_joules_are_those_of_its_links_and_its_clients(shown: MeterShown) -> None:
    priced = meter_priced(shown, AT_REST)
    # Table I: 200 kb/J up and down, 500 kb/J aside; what a sidelink's sender sends is not paid beside what arrives
    up, down, aside = 2000 * 8 / 200e3, 4000 * 8 / 200e3, 500 * 8 / 500e3
    assert priced.links_j == {
        "uplink": pytest.approx(up),
        "downlink": pytest.approx(2 * down),
        "sidelink": pytest.approx(aside),
        "control": 0,
    }
    assert priced.total_j == pytest.approx(up + 2 * down + aside)
    assert [client.name for client in shown.clients] == ["r1", "r2", "server"]  # 6500, 4570 and 2000 bytes
    assert priced.clients_j == [
        {"uplink": pytest.approx(up), "downlink": pytest.approx(down), "sidelink": 0},
        {"downlink": pytest.approx(down), "sidelink": pytest.approx(aside), "control": 0},
        {"uplink": 0},
    ]
    busy = [(each.direction, each.client, each.topics, each.messages) for each, _ in priced.busiest]
    assert busy[:3] == [("out", "r1", "model", 1), ("out", "r2", "model", 1), ("in", "r1", "up", 2)]
    told = total_section(shown, priced)
    assert "2.57 kB sent by clients, 10.5 kB got by them; 13.16 kB in all packets" in told  # 9 heads of 10 bytes
    assert "uplink 200 kb/J, downlink 200 kb/J, sidelink 500 kb/J" in told


def test_sliders_price_what_passed_again_and_the_downlink_follows_the_uplink(shown: MeterShown) -> None:
    up = meter_priced(shown, {**AT_REST, "ul_bit_per_j": 1.0}).links_j
    assert (up["uplink"], up["downlink"]) == (pytest.approx(0.08 / 10), pytest.approx(0.32 / 10))
    down = meter_priced(shown, {**AT_REST, "dl_bit_per_j": 1.0})
    assert (down.links_j["uplink"], down.links_j["downlink"]) == (pytest.approx(0.08), pytest.approx(0.32 / 10))
    assert "downlink 2000 kb/J" in total_section(shown, down)
    downlink = LINK_SLIDERS[1]
    own = shown.tariff.energy
    assert prices.value_text(downlink, 0.0, own) == "as E<sub>UL</sub>"
    assert prices.command("runs/mine", {**AT_REST, "dl_bit_per_j": 1.0}, own) == (
        "jouleswarm report runs/mine --set energy.dl_bit_per_j=2e+06"
    )
    assert prices.changes(AT_REST, own) == []


def test_windows_in_which_nothing_passed_are_there_with_nothing(shown: MeterShown) -> None:
    assert [(each.begin_s, each.passed.bytes) for each in shown.moments] == [
        (BEGAN_S, 2500),
        (BEGAN_S + 60, 0),
        (BEGAN_S + 120, 10_570),
    ]
    priced = meter_priced(shown, AT_REST)
    assert priced.moments_j == [pytest.approx(0.04), 0, pytest.approx(0.04 + 0.32 + 0.008)]
    payload, joules = (each["data"] for each in time_chart(shown, priced)["series"])
    assert payload == [[1_000_000, 2.5], [1_060_000, 0.0], [1_120_000, 10.57]]  # in kB
    assert [at for at, _ in joules] == [1_000_000, 1_060_000, 1_120_000]


def test_twelve_clients_stand_around_the_broker_and_the_others_as_one(tmp_path: Path) -> None:
    with MadeUpMeter(tmp_path / "many", LINKS) as meter:
        meter.pass_by(0, [(f"r{number}", "up", "in", 1000 - number) for number in range(15)])
    shown = look(tmp_path / "many")
    assert [client.name for client in shown.clients] == [*(f"r{number}" for number in range(12)), "3 others"]
    assert shown.clients[-1].by_link["uplink"].sent_bytes == 988 + 987 + 986
    assert shown.number == 15
    assert len(set(around(13))) == 13
    told = [each.text for each in ElementTree.fromstring(meter_svg(shown)).iter("title")]
    assert "r0 to broker, uplink: 1 kB" in told
    assert "3 others to broker, uplink: 2.961 kB" in told


def test_what_clients_and_topics_are_called_is_text_and_never_markup(tmp_path: Path) -> None:
    with MadeUpMeter(tmp_path / "bad", LINKS) as meter:
        meter.pass_by(0, [(HOSTILE, f"topic/{HOSTILE}", "in", 10), (HOSTILE, "up", "in", 10)])
    shown = look(tmp_path / "bad")
    priced = meter_priced(shown, AT_REST)
    drawn = ElementTree.fromstring(meter_svg(shown))
    assert f"{HOSTILE}: 20 B sent, 0 B got" in [each.text for each in drawn.iter("title")]
    table = ElementTree.fromstring(busiest_table(priced.busiest))
    assert f"topic/{HOSTILE}" in [cell.text for cell in table.iter("td")]
    assert [each.tag for each in table.iter() if each.tag == "script"] == []
    assert "<script" not in meter_heading("<script>", shown)
    for chart in (links_chart(shown, priced), clients_chart(shown, priced)):
        assert HOSTILE not in repr([[*each] for each in chart["series"]])  # names of options are never theirs
        assert HOSTILE not in [bar["label"]["formatter"] for bar in chart["series"][-1]["data"]]


def test_a_meter_that_nothing_has_passed_yet_is_shown_with_nothing(tmp_path: Path) -> None:
    with MadeUpMeter(tmp_path / "none", LINKS):
        shown = look(tmp_path / "none")
    priced = meter_priced(shown, AT_REST)
    assert (priced.total_j, shown.clients, shown.moments) == (0, (), ())
    assert "Nothing passed that a rule prices" in total_section(shown, priced)
    assert "broker" in [each.text for each in ElementTree.fromstring(meter_svg(shown)).iter("text")]
    assert [each["data"] for each in time_chart(shown, priced)["series"]] == [[], []]


def test_a_meter_is_read_again_when_it_has_written_and_runs_as_long_as_it_holds_its_directory(tmp_path: Path) -> None:
    folder = MeterFolder(tmp_path / "mine")
    with MadeUpMeter(tmp_path / "mine", LINKS) as meter:
        meter.pass_by(0, FIRST)
        before = load_metered(tmp_path / "mine")
        first = look(tmp_path / "mine")
        assert (first.status, len(first.metered.rows)) == ("running", len(before.rows))
    found = folder.look()
    assert found is not None
    assert found.status == "complete"
    assert folder.look() is found
