"""Lossy codecs at a robot's side of the protocol: order, duplicates, requests; and federated averaging end to end."""

import itertools
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from jouleswarm.agents.meta_stage import MetaLink
from jouleswarm.agents.partners import Partners
from jouleswarm.agents.peers import Exchange
from jouleswarm.agents.served import ServerLink
from jouleswarm.codecs.codec import Codec, codec_of
from jouleswarm.codecs.floats import FLOAT32, Float16
from jouleswarm.codecs.int8 import Int8
from jouleswarm.codecs.streams import WeightsEncoder
from jouleswarm.codecs.topk import TopK
from jouleswarm.common.bus.bus import MemoryBus, MemoryHub, Message
from jouleswarm.common.bus.listener import Listener
from jouleswarm.common.scenario.arms import Arm
from jouleswarm.common.scenario.reading import scenario_from
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.common.scenario.sections import Bus, Federation
from jouleswarm.common.wire import topics
from jouleswarm.common.wire.messages import ModelHeader, RoundRequest, encode_json
from jouleswarm.common.wire.models import encode_model
from jouleswarm.common.wire.types import Layout, Shapes, Tensors, Weights
from jouleswarm.datacenter.cluster_rounds import ClusterDesk, Turn
from jouleswarm.datacenter.services import WeightsService
from jouleswarm.learning.networks import build_qnetwork, shapes_of, to_weights
from jouleswarm.methods.fedavg import FedAvg
from jouleswarm.methods.graph import Neighbourhood

RUN, ARM, TASK, ME = "r", "fl", 1, 1
SHAPES = {"w": (4,)}
PATIENT_S, DEADLINE_S = 60.0, 20.0
HALF_OF_THEM = TopK(0.5)  # 2 of 4 entries


def header(agent: int, round_: int, **fields: Any) -> ModelHeader:
    return ModelHeader(
        task=TASK, agent=agent, round=round_, reward=1.0, samples=20, rewards={agent: (round_, 1.0)}, **fields
    )


def vector(*values: float) -> Weights:
    return {"w": np.array(values, np.float32)}


class Pair:
    """Robot 1 of two, and the hand of the other."""

    def __init__(self, codec: Codec = HALF_OF_THEM) -> None:
        self.hub = MemoryHub()
        here = Neighbourhood(agent=ME, task=TASK, cluster=(1, 2), neighbours=(2,), diameter=1)
        bus = self.hub.connect("agent-1")
        self.exchange = Exchange(bus, RUN, here, SHAPES, Bus(resend_after_s=PATIENT_S), Federation(), codec=codec)
        self.meta = MetaLink(self.exchange, lambda arm: SHAPES)
        self.other = self.hub.connect("other")
        self.open("fl")

    def open(self, arm: str) -> None:
        self.exchange.open_arm(Arm(arm, "fl", 0), self.exchange.here, 2)
        self.theirs = WeightsEncoder(self.exchange.codec)

    def send(self, payload: bytes, arm: str = ARM) -> None:
        self.other.publish(topics.weights(RUN, arm, TASK, 2), payload)

    def got(self, round_: int) -> list[float]:
        weights, _ = self.exchange.gather(round_)[2]
        return [float(value) for value in weights["w"]]


def heard(bus: MemoryBus) -> Message:
    message = bus.receive(DEADLINE_S)
    assert message is not None, "nothing was said"
    return message


def test_differences_are_applied_in_the_order_of_rounds_whatever_the_order_of_arrival() -> None:
    pair = Pair()
    first = pair.theirs.payload(vector(1, 1, 1, 1), header(2, 1))
    second = pair.theirs.payload(vector(5, 4, 1, 1), header(2, 2))
    third = pair.theirs.payload(vector(5, 4, 9, 8), header(2, 3))
    pair.send(second)  # the first was lost, and comes when it is asked for
    pair.send(first)
    assert pair.got(1) == [1, 1, 1, 1]
    pair.send(third)
    assert pair.got(2) == [5, 4, 1, 1]
    assert pair.got(3) == [5, 4, 9, 8]
    assert pair.exchange.refused == 0


def test_a_message_that_comes_twice_is_applied_once() -> None:
    pair = Pair()
    payloads = [
        pair.theirs.payload(vector(*values), header(2, round_))
        for round_, values in enumerate([(1, 1, 1, 1), (5, 4, 1, 1), (0, 0, 1, 1)], 1)
    ]
    for round_, payload in enumerate(payloads, 1):
        pair.send(payload)
        pair.send(payload)
        assert pair.got(round_) == [[1, 1, 1, 1], [5, 4, 1, 1], [0, 0, 1, 1]][round_ - 1]
        pair.send(payload)
    assert pair.exchange.refused == 0


def test_a_round_asked_for_again_is_the_same_bytes_and_leaves_the_state_alone() -> None:
    pair = Pair()
    ears = pair.hub.connect("ears")
    ears.subscribe(topics.weights(RUN, ARM, TASK, ME))
    sent = [
        pair.exchange.publish_weights(vector(*values), header(ME, round_))
        for round_, values in enumerate([(1, 2, 3, 4), (9, 9, 3, 4)], 1)
    ]
    assert [heard(ears).payload for _ in sent] == sent
    pair.other.publish(topics.resend(RUN, ARM, TASK, ME), encode_json(RoundRequest(first=2, last=2)))
    pair.send(pair.theirs.payload(vector(0, 0, 0, 0), header(2, 1)))
    pair.exchange.gather(1)
    assert heard(ears).payload == sent[1]
    assert pair.exchange.encoder.public["w"].tolist() == [9, 9, 3, 4]


def test_an_arm_begins_with_a_whole_model_again() -> None:
    pair = Pair()
    for round_ in (1, 2):
        pair.send(pair.theirs.payload(vector(round_, 0, 0, 0), header(2, round_)))
        pair.exchange.publish_weights(vector(round_, 0, 0, 0), header(ME, round_))
        pair.got(round_)
    pair.open("fl-t1")
    ears = pair.hub.connect("ears")
    ears.subscribe(topics.weights(RUN, "fl-t1", TASK, ME))
    pair.exchange.publish_weights(vector(7, 7, 7, 7), header(ME, 1))
    tensors, _ = pair.exchange.read(heard(ears).payload)
    assert tensors["w"].tolist() == [7, 7, 7, 7]
    pair.send(pair.theirs.payload(vector(8, 8, 8, 8), header(2, 1)), "fl-t1")
    assert pair.got(1) == [8, 8, 8, 8]


CODECS = {codec.name: codec for codec in (FLOAT32, Float16(), Int8(), TopK())}


@pytest.mark.parametrize(("got", "expected"), list(itertools.permutations(CODECS, 2)))
def test_weights_and_meta_models_of_another_codec_are_refused_counted_and_waited_past(got: str, expected: str) -> None:
    pair = Pair(CODECS[expected])
    pair.meta.listen([Arm("maml", "maml", 3)])
    wrong = WeightsEncoder(CODECS[got])
    pair.send(wrong.payload(vector(9, 9, 9, 9), header(2, 1)))
    pair.other.publish(topics.meta_model(RUN, "maml"), wrong.payload(vector(9, 9, 9, 9), header(2, 3)))
    right = WeightsEncoder(CODECS[expected])
    pair.other.publish(topics.meta_model(RUN, "maml"), right.payload(vector(0, 127, 0, -127), header(2, 3)))
    pair.send(pair.theirs.payload(vector(0, 127, 0, -127), header(2, 1)))  # exact in every codec
    assert pair.meta.await_model(Arm("maml", "maml", 3), 3)["w"].tolist() == [0, 127, 0, -127]
    assert pair.got(1) == [0, 127, 0, -127]
    assert pair.exchange.refused == 2


def test_a_meta_model_of_differences_is_refused() -> None:
    pair = Pair()
    pair.meta.listen([Arm("maml", "maml", 3)])
    payloads = [pair.theirs.payload(vector(1, 2, 3, 4), header(2, 3)) for _ in range(2)]
    pair.other.publish(topics.meta_model(RUN, "maml"), payloads[1])
    pair.other.publish(topics.meta_model(RUN, "maml"), payloads[0])
    assert pair.meta.await_model(Arm("maml", "maml", 3), 3)["w"].tolist() == [1, 2, 3, 4]
    assert pair.exchange.refused == 1


ROUNDS = 30
FEDAVG = Arm("fedavg", "fedavg", 0)


class Averaging:
    """Two robots that learn nothing but once, by `bump`, and the real parameter server between them."""

    def __init__(self, codec: Codec) -> None:
        self.scenario = _scenario(codec)
        self.server, self.hub = WeightsService(self.scenario, FEDAVG), MemoryHub()
        self.bus = self.hub.connect("datacenter")
        self.bus.subscribe(*(topics.weights_up(RUN, "fedavg", TASK, agent) for agent in (1, 2)))
        self.ends: dict[int, Weights] = {}

    def run(self, starts: dict[int, Weights], bump: Callable[[int, int, Weights], Weights]) -> None:
        threads = [
            threading.Thread(target=self._robot, args=(agent, start, bump), daemon=True)
            for agent, start in starts.items()
        ]
        for thread in threads:
            thread.start()
        for round_ in range(1, ROUNDS + 1):
            arrived: dict[int, Any] = {}
            while len(arrived) < 2:
                message = heard(self.bus)
                agent = int(message.topic.split("/")[5])
                got_round, _, content = self.server.read(message.payload, TASK, agent)
                assert got_round == round_
                arrived[agent] = self.server.opened(agent, [content])
            payload, _ = self.server.model(Turn(TASK, round_, arrived))
            self.bus.publish(topics.cluster_model(RUN, "fedavg", TASK), payload)
        for thread in threads:
            thread.join(DEADLINE_S)
        assert set(self.ends) == {1, 2}

    def _robot(self, agent: int, weights: Weights, bump: Callable[[int, int, Weights], Weights]) -> None:
        here = Neighbourhood(agent=agent, task=TASK, cluster=(1, 2), neighbours=(), diameter=1)
        shapes = {name: tensor.shape for name, tensor in weights.items()}
        bus, codec = self.hub.connect(f"agent-{agent}"), codec_of(self.scenario)
        exchange = Exchange(bus, RUN, here, shapes, Bus(resend_after_s=PATIENT_S), Federation(), codec=codec)
        exchange.open_arm(FEDAVG, here, 2, topics.weights_up)
        partners = Partners(exchange, FedAvg(), self.scenario.federation)
        for round_ in range(1, ROUNDS + 1):
            weights = bump(agent, round_, weights)
            partners.meet(weights, header(agent, round_))
            weights = partners.mixed(weights)
        self.ends[agent] = weights


def _scenario(codec: Codec, name: str = "") -> Scenario:
    return scenario_from(
        {
            "name": "t", "world": {"rows": 4, "cols": 3}, "methods": ["fedavg"],
            "network": {"width": 8, "height": 6, "conv": [[4, 3, 1]], "dense": [8]},
            "federation": {"codec": name or codec.name, "topk_share": getattr(codec, "share", 0.05)},
            "tasks": [{"id": 1, "map": ". E . \n . * . \n . * . \n . X ."}],
        },
        "test",
    )  # fmt: skip


@pytest.mark.parametrize("codec", [FLOAT32, Float16(), Int8(), TopK(0.2)])
def test_federated_averaging_loses_nothing_that_a_message_could_not_tell(codec: Codec) -> None:
    averaging = Averaging(codec)
    starts = {agent: to_weights(build_qnetwork(averaging.scenario, agent)) for agent in (1, 2)}
    rng = np.random.default_rng(1)
    moved = {name: rng.normal(size=tensor.shape).astype(np.float32) for name, tensor in starts[1].items()}

    def bump(agent: int, round_: int, weights: Weights) -> Weights:
        if (agent, round_) != (1, 3):
            return weights
        return {name: tensor + moved[name] for name, tensor in weights.items()}

    averaging.run(starts, bump)
    for name in moved:
        # the mean of both starts, and half of what one of the two has learned in round 3
        expected = (starts[1][name] + starts[2][name]) / 2 + moved[name] / 2
        coarse = {"float32": 1e-6, "float16": 2e-3, "int8": 3e-2, "topk": 1e-5}[codec.name]
        for end in averaging.ends.values():
            np.testing.assert_allclose(end[name], expected, rtol=0, atol=coarse)


class Summed:
    """A user's codec that checks nothing by itself: what does not add up raises as Python does, in `decode`."""

    name, lossless = "summed", True

    def layout(self, shapes: Shapes, whole: bool) -> Layout:
        return {f"{name}{end}": ("F32", shape) for name in shapes for end, shape in (("", shapes[name]), ("+", (1,)))}

    def encode(self, weights: Weights, base: Weights | None) -> Tensors:
        told = [(name, tensor, np.array([tensor.sum()], np.float32)) for name, tensor in weights.items()]
        return {name: array for key, tensor, total in told for name, array in ((key, tensor), (f"{key}+", total))}

    def decode(self, tensors: Tensors, shapes: Shapes, base: Weights | None) -> Weights:
        if any(tensors[name].sum() != tensors[f"{name}+"][0] for name in shapes):
            raise ArithmeticError("it does not add up")
        return {name: tensors[name] for name in shapes}


def summed(sender: int, weights: Weights, off: float = 0.0) -> bytes:
    """A message of `Summed`; `off`: of the right layout and sender, and none that decodes."""
    tensors = {name: tensor + off * name.endswith("+") for name, tensor in Summed().encode(weights, None).items()}
    return encode_model(tensors, header(sender, 1, codec="summed"))


def test_what_a_users_codec_cannot_decode_is_refused_and_waited_past(caplog: pytest.LogCaptureFixture) -> None:
    pair = Pair(Summed())
    pair.send(summed(2, vector(1, 2, 3, 4), off=1))
    pair.send(summed(2, vector(1, 2, 3, 4)))
    assert pair.got(1) == [1, 2, 3, 4]
    assert pair.exchange.refused == 1
    assert "refused round 1 of robot 2: codec summed: decode raises ArithmeticError: it does not add up" in caplog.text


def test_a_model_of_the_data_center_that_a_users_codec_cannot_decode_is_refused_too() -> None:
    pair = Pair(Summed())
    link = ServerLink(pair.exchange)
    for off in (1, 0):
        pair.other.publish(topics.cluster_model(RUN, ARM, TASK), summed(0, vector(1, 2, 3, 4), off))
    assert link.await_model(1)[0]["w"].tolist() == [1, 2, 3, 4]
    assert pair.exchange.refused == 1


def test_a_robot_that_sends_the_data_center_what_does_not_decode_is_waited_for() -> None:
    scenario = _scenario(Summed(), f"{__name__}:Summed")
    shapes, hub = shapes_of(build_qnetwork(scenario)), MemoryHub()
    listener, server = Listener(hub.connect("datacenter"), PATIENT_S), WeightsService(scenario, FEDAVG)
    desk = ClusterDesk(listener, scenario, RUN, "fedavg", server, 2)
    desk.listen()
    for agent, off in ((1, 1), (2, 0), (1, 0)):
        told = {name: np.full(shape, agent, np.float32) for name, shape in shapes.items()}
        hub.connect("robots").publish(topics.weights_up(RUN, "fedavg", TASK, agent), summed(agent, told, off))
    turn = desk.next_round()
    assert turn is not None
    assert {agent: float(model["0.bias"][0]) for agent, (model, _) in turn.arrived.items()} == {1: 1.0, 2: 2.0}
    assert desk.refused == 1
