"""A scenario's codecs, tried when the scenario is read: a few messages of one sender, with small random weights."""

from __future__ import annotations

import contextlib
import re
import reprlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from jouleswarm.codecs.codec import Codec, codec_of, share_of
from jouleswarm.codecs.models import builds_on_base, called, check_tensors, decoded, encoded
from jouleswarm.codecs.observations import FRAME, decode_observation, encode_experience, experience_codec_of
from jouleswarm.common.doors import words
from jouleswarm.common.errors import ConfigurationError, JouleSwarmError
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.spaces import Observation
from jouleswarm.common.wire.messages import CODEC_NAME, MotionHeader
from jouleswarm.common.wire.tensorfile import layout_bytes
from jouleswarm.common.wire.types import Array, Shapes, Tensors, Weights

SHAPES: Shapes = {"0.weight": (3, 2, 2, 2), "0.bias": (3,), "2.weight": (4, 6), "2.bias": (1,)}


def try_codecs(scenario: Scenario) -> None:
    """Open the scenario's codecs and send through them.

    Raises:
        ConfigurationError: one is none, raises, does not keep to its layout or does not bring back what was sent.
    """
    try_weights(scenario)
    if scenario.known_spaces is not None:  # else the environment is somebody's own, and has not been made yet
        try_experience(scenario)


def try_weights(scenario: Scenario) -> None:
    """Try the codec of weights, as `try_codecs`."""
    codec, named = codec_of(scenario), scenario.federation.codec
    with _told_of(codec, named), np.errstate(all="ignore"):
        _introduce(codec, named)
        for whole in (True, False):
            _look_at(codec, SHAPES, whole, least=0)
        _send(codec)
        needs_all = builds_on_base(codec)
    if needs_all and scenario.federation.on_missing == "proceed":
        raise ConfigurationError(
            f'federation.on_missing = "proceed" with codec {named}: expected a codec whose messages are whole, for who '
            "comes back has missed some"
        )


def try_experience(scenario: Scenario) -> None:
    """Try the codec of experience, as `try_codecs`, with an observation of random values."""
    codec, named, shown = experience_codec_of(scenario), scenario.meta.experience_codec, scenario.spaces.observation
    header = MotionHeader(task=1, agent=1, round=1, motion=0, action=0, reward=0.0, first=True, terminated=False)
    observation = _drawn(shown)
    with _told_of(codec, named), np.errstate(all="ignore"):
        _introduce(codec, named)
        _look_at(codec, {FRAME: shown.shape}, whole=True, least=-1)
        payload = encode_experience(observation, header, codec)
        got, _ = decode_observation(payload, codec, shown, shown.kept(scenario.network))
        if payload != encode_experience(observation, header, codec):
            raise ConfigurationError("the same observation gave two results; expected the same to the bit")
        if codec.lossless and got.tobytes() != observation.tobytes():
            raise ConfigurationError("it is lossless, and an observation came back with other bits")


def _drawn(shown: Observation) -> Array:
    rng, kind = np.random.default_rng(1), np.dtype(shown.dtype)
    if kind.kind == "f":
        return rng.normal(size=shown.shape).astype(kind)
    highest = shown.values or (2 if kind.kind == "b" else 100)
    return np.asarray(rng.integers(0, highest, shown.shape)).astype(kind)


@contextlib.contextmanager
def _told_of(codec: Codec, named: str) -> Iterator[None]:
    """An error becomes one line with the name that the scenario has for the codec."""
    try:
        yield
    except JouleSwarmError as error:
        told = str(error).removeprefix("motion of robot 1: ").removeprefix(f"codec {codec.name}: ")
        raise ConfigurationError(f"codec {named!r}: {told}") from error


def _introduce(codec: Codec, named: str) -> None:
    """Look at what a codec says of itself."""
    name: Any = codec.name
    if not isinstance(name, str) or not re.match(CODEC_NAME, name):
        raise ConfigurationError(f"its name is {name!r}, expected 1 to 32 letters, digits, '_', '.' or '-'")
    if name != named and name in words("codecs"):
        raise ConfigurationError(f"its name is {name!r}, which is another codec's; expected one of its own")
    if not isinstance(codec.lossless, bool):
        raise ConfigurationError(f"lossless is {codec.lossless!r}, expected True or False")
    share: Any = share_of(codec)
    if not isinstance(share, int | float) or not 0 < share <= 1:
        raise ConfigurationError(f"share is {share!r}, expected more than 0, 1 at most")


def _look_at(codec: Codec, shapes: Shapes, whole: bool, least: int) -> None:
    """Hold a layout against what a layout is; `least`: what a size may be, of which -1 varies, once."""
    layout: Any = called(codec, "layout", shapes, whole)
    try:
        layout_bytes(layout)
        sizes = [size for _, shape in layout.values() for size in shape]
        is_one = all(isinstance(size, int) and size >= least for size in sizes) and sizes.count(-1) <= 1
    except (AttributeError, KeyError, TypeError, ValueError):
        is_one = False
    if not is_one:
        raise ConfigurationError(f"layout gives {reprlib.repr(layout)}, expected name -> (safetensors dtype, shape)")


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
