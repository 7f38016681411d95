"""The contract of a codec: how weights are written with fewer bits, from float32 arrays to the wire and back.

A codec is pure and has no memory. What receivers hold of a sender, the base of its next message, is kept by the core
(see `codecs.streams`); so is what a message could not tell (error feedback). docs/doors.md is for who writes one.
"""

from __future__ import annotations

from typing import Any, Protocol

from jouleswarm.common.doors import open_door
from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Federation
from jouleswarm.common.wire.tensorfile import layout_of
from jouleswarm.common.wire.types import Layout, Shapes, Tensors, Weights

MEMBERS = ("name", "lossless", "layout", "encode", "decode")


class Codec(Protocol):
    """How weights are written.

    It may have besides:

    - `check(tensors, shapes)`: raises where tensors of the right layout are none that `encode` can have sent. It
      vouches that `decode` makes finite weights of all others; without it floats are held against `MAX_WEIGHT`, and so
      is what is decoded.
    - `share`: of the entries that a message tells, up to 1; the default consensus step is as much smaller.
    - `from_settings(federation)`, a class method: makes it, from the scenario's section; else the class is called.
    """

    @property
    def name(self) -> str:
        """In the header of every message; letters, digits, `_`, `.` and `-`, 32 at most."""

    @property
    def lossless(self) -> bool:
        """Whether receivers hold the sender's model to the bit."""

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        """Tensors on the wire: name -> (safetensors dtype, shape), whose bytes are what is priced.

        `whole`: of a message without a base, else of one with.
        """

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        """Finite float32 `weights` for the wire; `base`: what receivers hold, None: nothing, the message is whole."""

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        """What receivers hold then: float32, finite, the same to the bit on the sender and on each of them."""


def codec_of(scenario: Scenario) -> Codec:
    """The scenario's codec of weights.

    Raises:
        ConfigurationError: it has none, see `open_codec`.
    """
    return open_codec(scenario.federation.codec, scenario.federation, scenario)


def open_codec(name: str, settings: Federation, scenario: Scenario | None = None) -> Codec:
    """The codec of this name, made with these settings; `scenario` tells where the user's files are.

    Raises:
        ConfigurationError: nothing goes by that name, or what does is no codec.
    """
    found = scenario.open("codecs", name) if scenario else open_door("codecs", name, None)
    make = getattr(found, "from_settings", None)
    try:
        made: Any = make(settings) if make else found()
    except Exception as error:  # whatever a class of the user's does
        raise ConfigurationError(f"codec {name!r}: cannot be made: {type(error).__name__}: {error}") from error
    if lacking := [member for member in MEMBERS if not hasattr(made, member)]:
        raise ConfigurationError(f"codec {name!r}: has no {' and no '.join(lacking)}; expected {', '.join(MEMBERS)}")
    codec: Codec = made
    return codec


def share_of(codec: Codec) -> float:
    """Share of the entries that a message tells."""
    return float(getattr(codec, "share", 1.0))


def is_whole(codec: Codec, tensors: Tensors, shapes: Shapes) -> bool:
    """Whether a message can be read without a base."""
    return layout_of(tensors) == codec.layout(shapes, whole=True)
