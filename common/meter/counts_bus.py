"""Rows of meters over MQTT: sent by training loops, and heard by who writes a run directory.

A message is JSON: `from`, a name that no other sender has; `number`, from 1; `rows`, lists of the columns of a meter's
file. It goes out at QoS 1, so that it may come twice, and is in order.
"""

from __future__ import annotations

import json
import logging
import secrets
import ssl
import threading
import time
from collections.abc import Callable
from urllib.parse import quote

import paho.mqtt.client as mqtt
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.reasoncodes import ReasonCode

from jouleswarm.common.bus.address import BrokerAddress, parse_url
from jouleswarm.common.meter.counts_file import Rows

TOPIC = "jouleswarm/facts"
"""A level with the meter's name comes after it."""
_WAIT_S = 5.0
_MOST_UNSENT = 100  # messages; beyond, a meter goes on adding up
_KEEPALIVE_S, _LONGEST_DELAY_S = 30, 20

log = logging.getLogger("jouleswarm.meter")


class CountsBus:
    """Sends rows to whoever listens. A broker that is away ends nothing: it is told once, and tried again."""

    def __init__(self, name: str, url: str) -> None:
        """
        Raises:
            ConfigurationError: the URL is none.
        """
        self._name, self._address = name, parse_url(url)
        self._left_behind: list[mqtt.Client] = []
        self._begin()

    def _begin(self) -> None:
        self._id, self._number, self._is_told = secrets.token_hex(8), 0, False
        self._unsent: list[tuple[mqtt.MQTTMessageInfo, Rows]] = []
        self._is_connected = threading.Event()
        self._client = _client(self._address, f"{self._name}.{self._id[:8]}")
        self._client.on_connect = self._on_connect
        self._client.on_connect_fail = lambda *_: self._is_away("no connection")
        self._client.on_disconnect = lambda _client, _data, _flags, reason, _properties: self._is_away(str(reason))
        self._client.loop_start()

    def put(self, rows: Rows, *, wait: bool = True) -> bool:
        """Send them, if there is a connection; `wait`: some seconds for one, and until the broker has them.

        Returns whether they are taken; those who are not come with more the next time.
        """
        self._unsent = [(info, held) for info, held in self._unsent if not info.is_published()]
        if wait and rows:
            self._is_connected.wait(_WAIT_S)
        if not self._is_connected.is_set() or len(self._unsent) >= _MOST_UNSENT:
            return False
        if rows:
            self._number += 1
            told = {"from": self._id, "number": self._number, "rows": rows}
            topic = f"{TOPIC}/{quote(self._name, safe='')}"
            self._unsent.append((self._client.publish(topic, json.dumps(told), qos=1), rows))
        if wait:
            self._settle()
        return True

    def forked(self) -> None:
        """A child has a connection of its own, and its parent's is none of its business."""
        self._left_behind.append(self._client)
        self._begin()

    def close(self) -> Rows:
        """Go; what the broker has not acknowledged by then."""
        self._settle()
        self._is_told = True  # that it goes is nothing to tell
        self._client.disconnect()
        self._client.loop_stop()
        return [row for info, held in self._unsent if not info.is_published() for row in held]

    def _settle(self) -> None:
        until_s = time.monotonic() + _WAIT_S
        while time.monotonic() < until_s and not all(info.is_published() for info, _ in self._unsent):
            time.sleep(0.01)

    def _on_connect(self, _client: object, _data: object, _flags: object, reason: ReasonCode, _more: object) -> None:
        if reason.is_failure:
            self._is_away(str(reason))
        else:
            self._is_connected.set()

    def _is_away(self, reason: str) -> None:
        self._is_connected.clear()
        if not self._is_told:
            self._is_told = True
            log.warning(
                "meter %s: broker %s: %s; going on, and trying again: nothing that is counted is lost",
                *(self._name, self._address, reason),
            )


def hear(url: str, name: str, on_message: Callable[[bytes], None]) -> Callable[[], None]:
    """Have `on_message` called, in a thread, with each message of meters, also with those that came while there was no
    connection; returns what ends it. `name`: nobody else's.

    Raises:
        ConfigurationError: the URL is none.
    """
    address = parse_url(url)
    client = _client(address, f"jouleswarm-facts-{name}", clean_session=False)
    client.reconnect_delay_set(1, 1)  # so that it is there before those who send

    is_told, is_subscribed = threading.Event(), threading.Event()

    def is_away(reason: str) -> None:
        if not is_told.is_set():
            log.warning("broker %s: %s; what clients tell of themselves is not heard; trying again", address, reason)
        is_told.set()

    def subscribe(_client: object, _data: object, _flags: object, reason: ReasonCode, _more: object) -> None:
        if reason.is_failure:
            is_away(str(reason))
        else:
            client.subscribe(f"{TOPIC}/+", qos=1)

    def end() -> None:
        client.unsubscribe(f"{TOPIC}/+")  # so that the broker keeps nothing for it
        client.disconnect()
        client.loop_stop()

    client.on_connect = subscribe
    client.on_subscribe = lambda *_: is_subscribed.set()
    client.on_message = lambda _client, _data, message: on_message(bytes(message.payload))
    client.on_connect_fail = lambda *_: is_away("no connection")
    client.loop_start()
    is_subscribed.wait(_WAIT_S)  # what comes before is heard by nobody
    return end


def _client(address: BrokerAddress, client_id: str, *, clean_session: bool = True) -> mqtt.Client:
    """A client that is to connect once its thread is started."""
    client = mqtt.Client(CallbackAPIVersion.VERSION2, client_id, clean_session=clean_session)
    if address.user is not None:
        client.username_pw_set(address.user, address.password)
    if address.tls:
        client.tls_set_context(ssl.create_default_context())
    client.reconnect_delay_set(1, _LONGEST_DELAY_S)
    client.connect_async(address.host, address.port, _KEEPALIVE_S)
    return client
