"""A sender's models, one after the other, as receivers come to hold them: what a codec's messages build on."""

from __future__ import annotations

from jouleswarm.codecs.codec import Codec
from jouleswarm.codecs.models import builds_on_base, decoded, encoded
from jouleswarm.common.disk.state import State
from jouleswarm.common.errors import PayloadError, TrainingError
from jouleswarm.common.wire.messages import ModelHeader
from jouleswarm.common.wire.models import MAX_WEIGHT, PLAIN, encode_model, largest_weight
from jouleswarm.common.wire.types import Shapes, Tensors, Weights


class WeightsEncoder:
    """One sender's side, for one arm."""

    def __init__(self, codec: Codec) -> None:
        self.codec = codec
        self._public: Weights | None = None

    @property
    def public(self) -> Weights:
        """The model that every receiver holds once it has what was encoded last: the sender's public copy."""
        assert self._public is not None, "nothing has been encoded"
        return self._public

    def encode(self, weights: Weights) -> Tensors:
        """Tensors for the wire; whole the first time.

        Raises:
            TrainingError: receivers would refuse them, and ask for them again for ever.
        """
        for name, tensor in weights.items():
            if not (largest := largest_weight(tensor)) <= MAX_WEIGHT:
                raise TrainingError(
                    f"{name} has a weight of size {largest:g}, expected at most {MAX_WEIGHT:g}; lower the learning rate"
                )
        shapes = {name: tensor.shape for name, tensor in weights.items()}
        tensors = encoded(self.codec, weights, self._public)
        try:
            self._public = decoded(self.codec, tensors, shapes, self._public)
        except PayloadError as error:
            raise TrainingError(f"own weights do not come back: {error}") from error
        return tensors

    def payload(self, weights: Weights, header: ModelHeader, robots: int = 0) -> bytes:
        """The next message, with the codec in its header; as long as with the rewards of `robots` robots."""
        named = None if self.codec.name == PLAIN else self.codec.name
        return encode_model(self.encode(weights), header.model_copy(update={"codec": named}), robots)

    def rebase(self, public: Weights) -> None:
        """Receivers hold this model now, known to them from elsewhere; the next message builds on it."""
        self._public = public

    def state(self) -> State:
        return _state(self.codec, self._public)

    def load_state(self, state: State) -> None:
        self._public = state.arrays or None


class WeightsDecoder:
    """One receiver's side of one sender's messages of one arm. Each must be decoded once, in the order of rounds."""

    def __init__(self, codec: Codec, shapes: Shapes) -> None:
        self._codec, self._shapes = codec, shapes
        self._public: Weights | None = None

    def decode(self, tensors: Tensors) -> Weights:
        """The sender's public copy after checked tensors of `codecs.models.read_model`.

        Raises:
            PayloadError: differences to a model that never came, or no model comes of them.
        """
        self.rebase(public := self.decoded(tensors))
        return public

    def decoded(self, tensors: Tensors) -> Weights:
        """The same, not held: what is decoded next builds on what was before."""
        return decoded(self._codec, tensors, self._shapes, self._public)

    def rebase(self, public: Weights) -> None:
        self._public = public

    def state(self) -> State:
        return _state(self._codec, self._public)

    def load_state(self, state: State) -> None:
        self._public = state.arrays or None


def _state(codec: Codec, public: Weights | None) -> State:
    # What a lossless codec tells does not depend on what was told before, unless it tells differences.
    forgets = codec.lossless and not builds_on_base(codec)
    return State() if forgets or public is None else State(dict(public))
