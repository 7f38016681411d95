"""A short run of hostile connections against a broker process; `python -m fuzz.broker` is the long one."""

from __future__ import annotations

import pytest

from fuzz.broker import run
from fuzz.hostile_packets import KINDS


@pytest.mark.parametrize("proxy", [None, "embedded", pytest.param("mosquitto", marks=pytest.mark.external)])
def test_the_broker_and_an_honest_pair_live_through_every_kind_of_hostile_connection(tmp_path, proxy):
    result = run(4 * len(KINDS), 7, 16, 160.0, tmp_path / "broker.log", proxy=proxy)
    assert result.wrong == []
    for kind in KINDS:
        ends = result.by_kind[kind.name]
        assert ends.total() == 4
        assert not kind.ends or proxy == "mosquitto" or ends["broker"] == 4
    assert result.honest["sent"] >= 50
