"""A scenario's codec, tried when the scenario is read: a few messages of one sender, with small random weights."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from jouleswarm.codecs.codec import Codec, codec_of, share_of
from jouleswarm.codecs.models import builds_on_base, check_tensors, decoded, encoded
from jouleswarm.common.doors import words
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.wire.messages import CODEC_NAME
from jouleswarm.common.wire.tensorfile import layout_bytes
from jouleswarm.common.wire.types import Shapes, Tensors, Weights

SHAPES: Shapes = {"0.weight": (3, 2, 2, 2), "0.bias": (3,), "2.weight": (4, 6), "2.bias": (1,)}


def try_codec(scenario: Scenario) -> None:
    """Open the scenario's codec and send models through it.

    Raises:
        ConfigurationError: it is none, raises, does not keep to its layout or does not bring models back.
    """
    codec, named = codec_of(scenario), scenario.federation.codec
    try:
        _introduce(codec, named)
        with np.errstate(all="ignore"):
            _send(codec)
            needs_all = builds_on_base(codec)
    except JouleSwarmError as error:
        told = str(error).removeprefix(f"codec {codec.name}: ")
        raise ConfigurationError(f"codec {named!r}: {told}") from error
    if needs_all and scenario.federation.on_missing == "proceed":
        raise ConfigurationError(
            f'federation.on_missing = "proceed" with codec {named}: expected a codec whose messages are whole, for who '
            "comes back has missed some"
        )


def _introduce(codec: Codec, named: str) -> None:
    """Look at what a codec says of itself."""
    name: Any = codec.name
    if not isinstance(name, str) or not re.match(CODEC_NAME, name):
        raise ConfigurationError(f"its name is {name!r}, expected 1 to 32 letters, digits, '_', '.' or '-'")
    if name != named and name in words("codecs"):
        raise ConfigurationError(f"its name is {name!r}, which is another codec's; expected one of its own")
    if not isinstance(codec.lossless, bool):
        raise ConfigurationError(f"lossless is {codec.lossless!r}, expected True or False")
    if not 0 < share_of(codec) <= 1:
        raise ConfigurationError(f"share is {share_of(codec):g}, expected more than 0, 1 at most")
    for whole in (True, False):
        try:
            layout_bytes(codec.layout(SHAPES, whole))
        except Exception as error:  # a codec may be anybody's
            raise ConfigurationError(
                f"layout is no dict of name: (safetensors dtype, shape): {type(error).__name__}: {error}"
            ) from error


def _send(codec: Codec) -> None:
    """Three models, one after the other; then what receivers hold by now: there is nothing to tell."""
    rng, base = np.random.default_rng(1), None
    models = [{name: rng.normal(size=shape).astype(np.float32) for name, shape in SHAPES.items()} for _ in range(3)]
    models[0]["0.bias"][:2] = 0.0, -0.0
    for weights in models:
        got = _message(codec, weights, base)
        if not _distance(weights, got) < _distance(weights, base):
            raise ConfigurationError("it brings nothing back: after a message receivers are no nearer to the weights")
        base = got
    _message(codec, got, got)


def _message(codec: Codec, weights: Weights, base: Weights | None) -> Weights:
    """A message there and back: what receivers hold then."""
    _lock(weights)
    tensors = encoded(codec, weights, base)
    _lock(tensors)
    check_tensors(codec, tensors, SHAPES)
    got = decoded(codec, tensors, SHAPES, base)
    if not _same(tensors, encoded(codec, weights, base)) or not _same(got, decoded(codec, tensors, SHAPES, base)):
        raise ConfigurationError("the same weights and base gave two results; expected the same to the bit")
    if codec.lossless and not _same(got, weights):
        raise ConfigurationError("it is lossless, and weights came back with other bits")
    _lock(got)
    return got


def _lock(tensors: Tensors) -> None:
    """What comes from the bus, and what others go on with, cannot be changed in place."""
    for tensor in tensors.values():
        tensor.setflags(write=False)


def _same(one: Tensors, other: Tensors) -> bool:
    return all(one[name].tobytes() == other[name].tobytes() for name in one)


def _distance(weights: Weights, held: Weights | None) -> float:
    """Euclidean, over all entries; of who holds nothing, from zero."""
    return float(np.sqrt(sum(float(((w - (held[name] if held else 0)) ** 2).sum()) for name, w in weights.items())))
