"""The contract of a codec: how weights are written with fewer bits, from float32 arrays to the wire and back.

A codec is pure and has no memory. What receivers hold of a sender, the base of its next message, is kept by the core
(see `codecs.streams`); so is what a message could not tell (error feedback). docs/doors.md is for who writes one.
"""

from __future__ import annotations

from typing import Any, Protocol

from jouleswarm.common.errors import ConfigurationError
from jouleswarm.common.scenario.scenario import Scenario
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
    - `from_scenario(scenario)`, a class method: makes it; else the class is called.

    One for experience is given an observation in place of weights: an array of any dtype by the name of `frame`, and
    never a base. A size of -1 in its layout varies. What it decodes has the shape that the environment shows or that
    the network takes.
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
    return open_codec(scenario.federation.codec, scenario)


def open_codec(name: str, scenario: Scenario) -> Codec:
    """The codec of this name, made for a scenario.

    Raises:
        ConfigurationError: nothing goes by that name, or what does is no codec, or not for this scenario.
    """
    found = scenario.open("codecs", name)
    make = getattr(found, "from_scenario", None)
    try:
        made: Any = make(scenario) if make else found()
    except ConfigurationError as error:
        raise ConfigurationError(f"codec {name!r}: {error}") from error
    except Exception as error:  # whatever a class of the user's does
        raise ConfigurationError(f"codec {name!r}: cannot be made: {type(error).__name__}: {error}") from error
    if lacking := [member for member in MEMBERS if not hasattr(made, member)]:
        raise ConfigurationError(f"codec {name!r}: has no {' and no '.join(lacking)}; expected {', '.join(MEMBERS)}")
    codec: Codec = made
    return codec


def share_of(codec: Codec) -> float:
    """Share of the entries that a message tells."""
    share: float = getattr(codec, "share", 1.0)
    return share


def is_whole(codec: Codec, tensors: Tensors, shapes: Shapes) -> bool:
    """Whether a message can be read without a base."""
    return layout_of(tensors) == codec.layout(shapes, True)
