"""Users and rights read anew by SIGHUP, on a real broker with a copy of the toy scenario's keys."""

from __future__ import annotations

import shutil
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from argon2 import PasswordHasher

from jouleswarm.common.bus.credentials import credentials_of
from jouleswarm.common.wire import topics

MINE, HIS = topics.weights("r", "fl", 1, 1), topics.weights("r", "fl", 1, 2)


class Reread:
    """A broker, its files, and what it has logged."""

    def __init__(self, start_broker: Callable, keys: Path, folder: Path) -> None:
        self.keys, own = keys, folder / "broker"
        shutil.copytree(keys / "broker", own)
        self.users, self.rights = own / "users", own / "rights"
        files = ("--users", str(self.users), "--rights", str(self.rights))
        self.broker = start_broker(*files, stderr=subprocess.PIPE)

    def hang_up(self) -> list[str]:
        """SIGHUP; the lines that the broker logs until it has read its files."""
        self.broker.process.send_signal(signal.SIGHUP)
        lines = [self.broker.process.stderr.readline()]
        while not lines[-1].endswith(("from now on\n", "before stay\n")):
            lines.append(self.broker.process.stderr.readline())
        return lines

    def without(self, user: str) -> None:
        lines = self.users.read_text().splitlines(keepends=True)
        self.users.write_text("".join(line for line in lines if not line.startswith(f"{user}:")))

    def password(self, user: str) -> str:
        return credentials_of(self.keys, user).password


@pytest.fixture
def reread(start_broker, keys, tmp_path) -> Reread:
    return Reread(start_broker, keys, tmp_path)


@pytest.fixture
def join(reread, raw):
    """A client that has logged in."""

    def connect(user: str, **options):
        client = raw(reread.broker)
        client.present = client.connect(user, login=(user, reread.password(user)), **options)
        return client

    return connect


def test_who_is_no_user_any_more_is_ended_with_its_will_and_cannot_come_back(reread, join, raw):
    his = topics.presence("r", 1, 2)
    robot, neighbour = join("agent-2", will=(his, b"gone")), join("agent-1")
    neighbour.subscribe(topics.presence("r", 1, "+"))
    reread.without("agent-2")
    reread.rights.write_text(reread.rights.read_text().replace("user agent-2\n", "user nobody\n"))  # its rights too
    (line,) = reread.hang_up()
    assert line.endswith(f"6 users of {reread.users} and the rights of {reread.rights} from now on\n")
    assert robot.is_closed_by_broker()
    assert neighbour.read_publish()[1::2] == (his, b"gone")
    assert raw(reread.broker).log_in("agent-2", reread.password("agent-2")) == 4
    neighbour.ping()
    reread.broker.counted("dropped_taken_out", 1)


def test_its_persistent_session_ends_whether_it_is_there_or_away(reread, join):
    here, away = join("agent-1", clean=False), join("agent-3", clean=False)
    away.send(0xE0)
    assert away.is_closed_by_broker()
    users = reread.users.read_text()
    reread.without("agent-1")
    reread.without("agent-3")
    reread.hang_up()
    assert here.is_closed_by_broker()
    reread.users.write_text(users)
    reread.hang_up()
    assert [join(user, clean=False).present for user in ("agent-1", "agent-3")] == [0, 0]


def test_who_stays_keeps_its_session_while_another_is_taken_out(reread, join):
    away = join("agent-1", clean=False)
    away.send(0xE0)
    assert away.is_closed_by_broker()
    reread.without("agent-2")
    reread.hang_up()
    assert join("agent-1", clean=False).present == 1


def test_another_password_ends_who_came_by_the_old_one(reread, join, raw):
    robot = join("agent-1")
    reread.without("agent-1")
    hasher = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
    reread.users.write_text(f"{reread.users.read_text()}agent-1:{hasher.hash('new')}\n")
    reread.hang_up()
    assert robot.is_closed_by_broker()
    assert raw(reread.broker).log_in("agent-1", reread.password("agent-1")) == 4
    assert raw(reread.broker).log_in("agent-1", "new") == 0


def test_new_rights_hold_for_who_is_there(reread, join):
    sender, receiver = join("agent-1"), join("agent-2")
    assert receiver.subscribe(MINE) == 1
    assert receiver.subscribe("elsewhere") == 0x80
    sender.publish(HIS, b"refused", qos=1)
    reread.rights.write_text(f"user agent-1\ntopic write {HIS}\ntopic write {MINE}\nuser agent-2\ntopic read {HIS}\n")
    reread.hang_up()
    assert receiver.subscribe(HIS) == 1
    sender.publish(MINE, b"what it may not read any more, by a filter that it was granted", qos=1)
    sender.publish(HIS, b"granted", qos=1)
    assert receiver.read_publish()[3] == b"granted"


@pytest.mark.parametrize("bad", ["users", "rights"])
def test_a_bad_file_is_one_line_and_neither_changes(reread, join, raw, bad):
    robot = join("agent-1")
    reread.without("agent-2")
    if bad == "users":
        reread.users.write_text(f"{reread.users.read_text()}agent-2:plain\n")
        told = f"{reread.users}, line 7, user 'agent-2': expected NAME:$argon2id$"
    else:
        reread.rights.write_text("user agent-1\ntopics #\n")
        told = f"{reread.rights}, line 2: got 'topics #'; expected"
    (line,) = reread.hang_up()
    assert told in line
    assert line.endswith("; the users and rights before stay\n")
    assert raw(reread.broker).log_in("agent-2", reread.password("agent-2")) == 0
    robot.publish(MINE, b"as before", qos=1)
    assert reread.broker.event("refused_not_permitted") == 0
