"""Two processes cannot be the same robot: who comes second is refused, and who was there first goes on."""

from __future__ import annotations

import secrets
import time

from jouleswarm.common.bus.bus import Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import Claim, Presence, decode_json, encode_json


class Identity:
    """A process's claim to be robot `agent` of a run (0: the data center), and its word of where it stands.

    The claim comes back from the broker. Whatever another process claimed before it, in the broker's order, came
    first. A retained presence without an answer is of a process that hangs or has just been killed: the broker tells
    by its last will when it is gone, after 1.5 keepalives at the latest.
    """

    def __init__(
        self,
        listener: Listener,
        run: str,
        task: int,
        agent: int,
        keepalive_s: float,
        processor: str | None = None,
    ) -> None:
        """`processor`: what the process computes on (see `common.host`), told with its presence."""
        self._listener, self._bus, self._agent = listener, listener.bus, agent
        self._topic, self.presence = topics.claim(run, task, agent), topics.presence(run, task, agent)
        self._processor = processor
        self._who, self._patience_s = secrets.token_hex(8), 2 * keepalive_s
        self._holds = self._echoed = self._contested = self._somebody = False
        self.stage: int | None = None
        """Announced last; None before."""
        self.rewards: dict[int, float] = {}
        """Robot -> what it was rewarded before the first round of the open arm; told with the stage."""
        self.filters = [self.presence, self._topic]

    def claim(self) -> None:
        """Become the robot. Waits for one that seems to be there and does not answer.

        Raises:
            ConfigurationError: another process is this robot; the bus has been closed.
        """
        self._listener.handlers["claim"] = self._take_claim
        self._bus.subscribe(*self.filters)
        until = time.monotonic() + self._patience_s
        self._say(holds=False)

        def settled() -> bool:
            free = self._echoed and not self._somebody
            return free or self._contested or time.monotonic() >= until

        def ask() -> None:
            if not self._echoed:  # said after its echo it would seem to have come later than it has
                self._say(holds=False)

        self._listener.until(settled, self._waits_for, ask)
        if self._contested:
            self._bus.close()
            name = f"robot {self._agent}" if self._agent else "the data center"
            raise ConfigurationError(
                f"{name} of this run is another process already, which goes on; expected one: end that one first, or "
                "name another --id or --run"
            )
        self._holds = True

    def announce(self, stage: int) -> None:
        """Tell everybody how far this process has come."""
        self.stage = stage
        presence = Presence(agent=self._agent, stage=stage, processor=self._processor, rewards=self.rewards)
        self._bus.publish(self.presence, encode_json(presence), retain=True)

    def heard(self, presence: Presence) -> None:
        """What the bus says of this process itself: the last will of a lost connection is set right."""
        if not self._holds:
            self._somebody = presence.state == "here"
        elif presence.state == "gone" and self.stage is not None:
            self.announce(self.stage)

    def _waits_for(self) -> str:
        return "the broker" if not self._echoed else "the process before this one, which seems to be there, to end"

    def _take_claim(self, message: Message) -> None:
        claim = decode_json(message.payload, Claim)
        if claim.who == self._who:
            self._echoed = True
        elif claim.holds:
            self._contested = self._contested or not self._holds
        elif self._echoed:  # it came later, also while this one still waits for the process before it to end
            self._say(holds=True)
        else:
            self._contested = True

    def _say(self, *, holds: bool) -> None:
        self._bus.publish(self._topic, encode_json(Claim(agent=self._agent, who=self._who, holds=holds)))
