"""`jouleswarm keys init`: what lies in the folder, who may read it, and what it does not overwrite."""

from __future__ import annotations

import datetime
import stat
import subprocess
import sys
from pathlib import Path

import pytest
from argon2 import PasswordHasher, Type, extract_parameters
from cryptography import x509

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.fleet.keys import make_keys, refresh_keys, remove_keys

ROOT = Path(__file__).parents[2]
TOY = ROOT / "scenarios" / "toy.toml"
CLIENTS = ["agent-1", "agent-2", "agent-3", "agent-4", "datacenter", "recorder", "health"]


def jouleswarm(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "jouleswarm", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)


def certificate(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_the_folder_holds_one_folder_for_the_broker_and_one_for_each_client(keys) -> None:
    assert sorted(each.name for each in keys.iterdir()) == sorted(["ca.crt", "ca.key", "broker", *CLIENTS])
    broker = sorted(each.name for each in (keys / "broker").iterdir())
    assert broker == ["ca.crt", "rights", "server.crt", "server.key", "users"]
    for client in CLIENTS:
        own = sorted(each.name for each in (keys / client).iterdir())
        assert own == ["ca.crt", "client.crt", "client.key", "password"]
        assert (keys / client / "ca.crt").read_bytes() == (keys / "ca.crt").read_bytes()


def test_private_files_are_their_owners_alone(keys) -> None:
    assert {mode(each) for each in [keys, *(path for path in keys.rglob("*") if path.is_dir())]} == {0o700}
    private = {"ca.key", "server.key", "client.key", "password", "users", "rights"}
    assert {mode(path) for path in keys.rglob("*") if path.name in private} == {0o600}


def test_users_are_the_clients_with_hashes_of_their_passwords(keys) -> None:
    users = dict(line.split(":", 1) for line in (keys / "broker" / "users").read_text().splitlines())
    assert list(users) == CLIENTS
    passwords = [(keys / client / "password").read_text().strip() for client in CLIENTS]
    assert len(set(passwords)) == len(CLIENTS)
    for password, encoded in zip(passwords, users.values(), strict=True):
        assert PasswordHasher().verify(encoded, password)
        parameters = extract_parameters(encoded)
        assert parameters.type is Type.ID
        assert (parameters.memory_cost, parameters.time_cost, parameters.parallelism) == (19456, 2, 1)


def test_certificates_are_signed_by_the_ca_and_name_their_client_or_hosts(keys) -> None:
    ca = certificate(keys / "ca.crt")
    for client in CLIENTS:
        own = certificate(keys / client / "client.crt")
        own.verify_directly_issued_by(ca)
        assert own.subject.rfc4514_string() == f"CN={client}"
    server = certificate(keys / "broker" / "server.crt")
    server.verify_directly_issued_by(ca)
    names = server.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["localhost"]
    assert [str(each) for each in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1"]
    assert server.not_valid_after_utc - server.not_valid_before_utc == datetime.timedelta(days=2, minutes=5)
    assert server.public_key().curve.name == "secp256r1"


def test_an_existing_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    with pytest.raises(ConfigurationError, match=r"is there already, .* give another --out"):
        make_keys(load_scenario(TOY), tmp_path, ["localhost"], days=1)
    assert [each.name for each in tmp_path.iterdir()] == ["mine"]


@pytest.mark.parametrize("host", ["", "a b", "*.example", "http://a"])
def test_a_host_that_is_none_makes_nothing(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigurationError, match="--hosts: got"):
        make_keys(load_scenario(TOY), tmp_path / "keys", ["localhost", host], days=1)
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_to_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(ConfigurationError, match=r"cannot make .*choose another --out"):
        make_keys(load_scenario(TOY), tmp_path / "file" / "keys", ["localhost"], days=1)


def test_refresh_keeps_what_serves_and_replaces_what_does_not(tmp_path: Path) -> None:
    toy, out = load_scenario(TOY), tmp_path / "keys"
    assert refresh_keys(toy, out, ["localhost"], 30) == CLIENTS
    password = (out / "agent-1" / "password").read_text()
    assert refresh_keys(toy, out, ["localhost"], 30) is None
    assert (out / "agent-1" / "password").read_text() == password
    more = load_scenario(TOY, ["federation.robots_per_cluster=3"])
    assert "agent-6" in (refresh_keys(more, out, ["localhost"], 30) or ())
    assert refresh_keys(more, out, ["broker"], 30) is not None  # other hosts
    assert refresh_keys(more, out, ["broker"], 30) is None
    assert refresh_keys(toy, out, ["broker"], 6) == CLIENTS
    assert refresh_keys(toy, out, ["broker"], 30) == CLIENTS  # six days were left, fewer than seven


def test_refresh_removes_no_folder_that_is_something_else(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("precious")
    with pytest.raises(ConfigurationError, match="no folder of keys; nothing was removed"):
        refresh_keys(load_scenario(TOY), tmp_path, ["localhost"], 30)
    assert (tmp_path / "mine").read_text() == "precious"


def test_who_is_removed_is_no_user_and_has_no_folder_and_the_rest_still_serves(tmp_path: Path) -> None:
    toy, out = load_scenario(TOY), tmp_path / "keys"
    make_keys(toy, out, ["localhost"], 30)
    before = (out / "broker" / "users").read_text().splitlines()
    removed = jouleswarm("keys", "remove", "agent-2", "agent-3", "--out", str(out))
    assert removed.returncode == 0, removed.stderr
    assert "agent-2, agent-3 taken out" in removed.stdout
    users = out / "broker" / "users"
    assert (users.read_text().splitlines(), mode(users)) == (before[:1] + before[3:], 0o600)
    assert sorted(each.name for each in (out / "broker").iterdir()) == [
        "ca.crt", "rights", "server.crt", "server.key", "users"
    ]  # fmt: skip
    assert not (out / "agent-2").exists()
    assert (out / "agent-1" / "password").exists()
    assert refresh_keys(toy, out, ["localhost"], 30) is None  # which would let it in again


def test_who_is_no_client_is_told_with_those_that_are_and_nothing_is_removed(tmp_path: Path) -> None:
    out = tmp_path / "keys"
    make_keys(load_scenario(TOY), out, ["localhost"], 30)
    with pytest.raises(ConfigurationError, match=r"got agent-9; expected some of agent-1, agent-2, .*, health"):
        remove_keys(out, ["agent-1", "agent-9"])
    assert (out / "agent-1" / "password").exists()
    with pytest.raises(ConfigurationError, match=r"cannot use .*users: No such file or directory; give the folder of"):
        remove_keys(tmp_path, ["agent-1"])


def test_the_command_says_what_it_made_and_what_to_do_next(tmp_path: Path) -> None:
    out = tmp_path / "keys"
    made = jouleswarm("keys", "init", str(TOY), "--out", str(out), "--hosts", "broker, 127.0.0.1")
    assert made.returncode == 0, made.stderr
    for each in ("agent-4, datacenter, recorder, health", "broker, 127.0.0.1", f"jouleswarm run {TOY} --keys {out}",
                 f".broker --keys {out}", f"--keys {out} --broker mqtts://broker:8883"):  # fmt: skip
        assert each in made.stdout
    secrets = [path.read_text().strip() for path in out.rglob("password")]
    assert not any(secret in made.stdout for secret in secrets)
    again = jouleswarm("keys", "init", str(TOY), "--out", str(out))
    assert (again.returncode, again.stdout) == (2, "")
    (line,) = again.stderr.splitlines()
    assert "is there already" in line


def test_help_teaches(tmp_path: Path) -> None:
    said = jouleswarm("keys", "init", "--help").stdout
    for each in (
        "FOLDER/agent-1/",
        "--hosts",
        "--days",
        "python -m jouleswarm.broker --host 0.0.0.0 --keys keys",
        "mqtts://",
    ):
        assert each in said
