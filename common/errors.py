"""Every error that JouleSwarm raises on purpose: one shallow tree.

A message names what was got, what was expected and what to do. `exit_code` is what a process ends with
when the error reaches its top.
"""


class JouleSwarmError(Exception):
    """Root of the tree; catch this to catch all of ours."""

    exit_code = 1


class ConfigurationError(JouleSwarmError):
    """A scenario, map, option or URL that cannot be used. Nothing has been written."""

    exit_code = 2


class BrokerUnreachableError(JouleSwarmError):
    """No broker answered within the time allowed."""

    exit_code = 3


class PayloadError(JouleSwarmError):
    """A message from the bus that is not what its topic promises. It is refused and counted, never fatal."""


class TrainingError(JouleSwarmError):
    """Learning went wrong (a loss that is not finite, say). Always ends the process."""

    exit_code = 4


class RunError(JouleSwarmError):
    """A run that cannot go on or cannot be read: a process died, a file is missing."""

    exit_code = 5


class MessageTooLargeError(RunError):
    """A message that the broker does not take for its size. It would be sent, refused and sent again for ever."""


class StudyError(JouleSwarmError):
    """A study that cannot be planned, run to its end or read back."""

    exit_code = 6
