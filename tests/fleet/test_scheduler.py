"""A Dask cluster that a deployment cannot run on is told in one line, before anything is written."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.fleet import scheduler as module
from jouleswarm.fleet.place import place_of
from jouleswarm.fleet.scheduler import address_for, check_protected, check_shared, check_versions, client_of, cluster_of

A, B = "tcp://10.0.0.1:1", "tcp://10.0.0.2:1"


def test_workers_of_this_version_will_do() -> None:
    check_versions({A: "0.1.0", B: "0.1.0"})


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ({A: "0.1.0", B: "0.2.0"}, rf"worker {B} has version 0\.2\.0 of JouleSwarm, this is version 0\.1\.0; install"),
        ({A: "0.0.9", B: "0.2.0"}, rf"worker {A} has version 0\.0\.9 .*, and 1 more workers another than this;"),
        ({A: ImportError("jouleswarm")}, rf"worker {A} has no JouleSwarm \(ImportError\('jouleswarm'\)\)"),
    ],
)
def test_a_worker_of_another_version_is_named(found: dict[str, str | BaseException], told: str) -> None:
    with pytest.raises(ConfigurationError, match=told) as caught:
        check_versions(found)
    assert "\n" not in str(caught.value)


def test_the_broker_is_told_by_the_address_on_the_way_to_all_workers() -> None:
    assert address_for([A, B], {"10.0.0.1": "10.0.0.9", "10.0.0.2": "10.0.0.9"}.__getitem__) == "10.0.0.9"
    assert address_for(["tcp://127.0.0.1:40001"]) == "127.0.0.1"


def test_several_addresses_are_for_the_user_to_choose_from() -> None:
    ways = {"10.0.0.1": "10.0.0.9", "10.0.0.2": "10.1.0.9"}
    with pytest.raises(ConfigurationError, match=r"\(10\.0\.0\.9, 10\.1\.0\.9\); say with --listen HOST:0"):
        address_for([A, B], ways.__getitem__)


def test_a_broker_that_others_reach_needs_keys_or_a_word() -> None:
    check_protected("127.0.0.1", with_keys=False, is_asked_for=False)
    check_protected("10.0.0.9", with_keys=True, is_asked_for=False)
    check_protected("10.0.0.9", with_keys=False, is_asked_for=True)
    told = re.escape("`jouleswarm keys init SCENARIO --hosts 10.0.0.9`")
    with pytest.raises(ConfigurationError, match=f"{told}.* --listen 10.0.0.9:0"):
        check_protected("10.0.0.9", with_keys=False, is_asked_for=False)


def test_no_scheduler_and_no_worker_is_one_line_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_CONNECT_TIMEOUT_S", 0.1)
    monkeypatch.setattr(module, "_WORKERS_TIMEOUT_S", 0.1)
    for nowhere in ("tcp://127.0.0.1:1", "nonsense"):
        with pytest.raises(ConfigurationError, match=f"no Dask scheduler answered at '{nowhere}' .*; expected"):
            client_of(nowhere)
    monkeypatch.setattr(module, "_CONNECT_TIMEOUT_S", 10)
    with LocalCluster(n_workers=0, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        address = cluster.scheduler_address
        with pytest.raises(ConfigurationError, match=f"{address} has no workers; start some"), cluster_of(address):
            pass


def test_a_folder_that_a_worker_does_not_see_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        check_shared(client, tmp_path)
        assert list(tmp_path.iterdir()) == []
        monkeypatch.setattr(client, "run", lambda *asked: {A: True, B: False})  # whose disk is another
        with pytest.raises(ConfigurationError, match=rf"worker {B} does not see .*{tmp_path}.*\(1 of 2 workers\)"):
            check_shared(client, tmp_path)


def test_a_place_to_listen_is_of_the_embedded_broker_alone(tmp_path: Path) -> None:
    told = pytest.raises(ConfigurationError, match="--listen is of the embedded broker")
    with told, place_of(None, tmp_path, "127.0.0.1:0", "mqtt://h", with_keys=False):
        pass
    with place_of(None, tmp_path, ":1883", None, with_keys=False) as place:
        assert (place.listen, place.host, place.client) == ((None, 1883), "127.0.0.1", None)
