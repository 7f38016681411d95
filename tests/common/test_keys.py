"""Keys that others can read are warned of, once a process and in one line."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from jouleswarm.broker.options import Options
from jouleswarm.broker.protection import protection_of
from jouleswarm.common.bus.credentials import credentials_of, exposed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Keys of a robot and of the broker, for their owner alone."""
    files = ["ca.key", "agent-1/password", "agent-1/client.key", "broker/server.key", "broker/users", "broker/rights"]
    for name in files:
        path = tmp_path / name
        path.parent.mkdir(mode=0o700, exist_ok=True)
        path.write_text("")
        path.chmod(0o600)
    tmp_path.chmod(0o700)
    return tmp_path


def test_keys_of_their_owner_alone_are_as_they_should_be(folder: Path) -> None:
    assert exposed(folder) == []


@pytest.mark.parametrize(
    ("folder_mode", "file_mode", "seen"),
    [(0o755, 0o644, True), (0o750, 0o640, True), (0o700, 0o644, False), (0o755, 0o600, False), (0o750, 0o604, False)],
)
def test_a_file_is_read_by_whom_its_folder_lets_in_and_its_mode_lets_read(
    folder: Path, folder_mode: int, file_mode: int, seen: bool
) -> None:
    password = folder / "agent-1" / "password"
    password.parent.chmod(folder_mode)
    password.chmod(file_mode)
    assert exposed(folder) == ([password] if seen else [])


def test_what_is_no_secret_may_be_read(folder: Path) -> None:
    (folder / "broker").chmod(0o755)
    (folder / "broker" / "rights").chmod(0o644)
    assert exposed(folder) == []


def test_who_takes_keys_that_others_can_read_is_warned_once(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name in ("agent-1", "broker"):
        (folder / name).chmod(0o755)
    for secret in exposed_by_mode(folder):
        secret.chmod(0o644)
    with caplog.at_level(logging.WARNING):
        credentials_of(folder, "agent-1")
        credentials_of(folder, "agent-1")
    (record,) = caplog.records
    assert record.getMessage() == (
        f"warning: others than the owner can read {folder}/agent-1/client.key and 3 more; chmod -R go= {folder} "
        "keeps them out"
    )


def exposed_by_mode(folder: Path) -> list[Path]:
    return [path for path in folder.glob("*/*") if path.name != "rights"]


def test_the_broker_warns_of_single_files_too(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    certificate, key = folder / "server.crt", folder / "server.key"
    folder.chmod(0o755)
    for path in (certificate, key):
        path.write_text("")
        path.chmod(0o644)
    with caplog.at_level(logging.WARNING):
        protection_of(Options(tls_cert=certificate, tls_key=key))
    assert [record.getMessage() for record in caplog.records] == [
        f"warning: others than the owner can read {key}; chmod go= {key} keeps them out"
    ]
