"""A price list of one's own: the paper's equations, and a tail of the radio after every message that goes up.

A cellular modem stays awake for a while after it has sent, whatever the size of the message.
"""

from jouleswarm import literal


class Cellular:
    name, label, tail_j = "cellular", "cellular, 0.9 J a message", 0.9

    def price(self, facts, energy):
        up = {"ml": 0, "fl": 0}
        for flow in facts.flows:
            if flow.link == "uplink":
                up[flow.phase] += flow.messages
        more = {phase: {"uplink_j": self.tail_j * messages} for phase, messages in up.items()}
        return literal.price(facts, energy).plus(**more)
