"""FedProx (Li et al. 2020): each robot's loss grows as it goes away from where the round began.

In a scenario: `methods = ["fl", "fedprox:FedProx", "fedprox:FedProxByServer"]` (see docs/doors.md).
"""

from jouleswarm import Method


class FedProx(Method):
    name, label, colour = "fedprox", "FedProx", "#CC79A7"
    mu = 0.01

    def penalty(self, params, start):
        """mu / 2 |W - W_start|^2, of all parameters together: its gradient is mu (W - W_start)."""
        return self.mu / 2 * sum(((params[key] - start[key]) ** 2).sum() for key in params)


class FedProxByServer(FedProx):
    """As Li et al. have it: the data center averages, in place of neighbours who mix."""

    name, label, colour = "fedprox-server", "FedProx by server", "#56B4E9"
    partners = "datacenter"
