"""The data center's gradient of one task, here beside the same by `functional_call` and autograd; one thread.

    python -m benchmarks.datacenter_gradient [--scenarios paper quick] [--repeats 11]

A plain gradient (joint training), a first-order meta-gradient and an exact one, of one support and one query batch of
the scenario's size. Processor time.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor
from torch.func import functional_call

from benchmarks.harness import compare, cpu_seconds, in_turn, parser
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.common.scenario.scenario import Scenario
from jouleswarm.learning.dqn import td_loss, td_target
from jouleswarm.learning.meta import meta_gradient, plain_gradient
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.learning.passes import Params
from jouleswarm.learning.qnetwork import QNetwork
from jouleswarm.learning.task_loss import Loss, TensorBatch, make_loss
from jouleswarm.methods.beta import made_up_batches

OF_A_TURN_S = 0.1
Kind = Callable[[Loss[TensorBatch]], object]


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--scenarios", nargs="+", default=["paper", "quick"])
    known.add_argument("--repeats", type=int, default=11)
    options = known.parse_args()
    use_one_thread()
    for name in options.scenarios:
        scenario = load_scenario(name)
        model = build_qnetwork(scenario, 1)
        params = {each: value.detach() for each, value in model.named_parameters()}
        losses = {
            "here": make_loss(model, params, scenario.learning.discount, double=scenario.learning.double),
            "before": by_functional_call(model, params, scenario),
        }
        for what, kind in _kinds(scenario, model, params).items():
            count = max(1, round(OF_A_TURN_S / cpu_seconds(partial(kind, losses["here"]))))
            sides = {side: partial(_repeated, kind, loss, count) for side, loss in losses.items()}
            found = in_turn({side: partial(cpu_seconds, run) for side, run in sides.items()}, options.repeats)
            print(compare(f"{what} of {name}", found, factor=1e3 / count))


def _kinds(scenario: Scenario, model: QNetwork, params: Params) -> dict[str, Kind]:
    support, query = (
        [batch] for batch in made_up_batches(scenario, model, scenario.meta.batch_size, 2, torch.device("cpu"))
    )
    mu, clip = scenario.meta.inner_lr, scenario.learning.grad_clip
    return {
        "a plain gradient": lambda loss: plain_gradient(loss, params, support),
        "a first-order meta-gradient": lambda loss: meta_gradient(
            params, support, query, loss, mu, exact=False, clip=clip
        ),
        "an exact meta-gradient": lambda loss: meta_gradient(params, support, query, loss, mu, exact=True, clip=clip),
    }


def by_functional_call(model: QNetwork, target: Params, scenario: Scenario) -> Loss[TensorBatch]:
    """The loss as it was before layers were gone through here."""
    double, discount = scenario.learning.double, scenario.learning.discount

    def loss(params: Params, batch: TensorBatch, /) -> Tensor:
        next_q_target = functional_call(model, target, (batch.next_frames,)).detach()
        detached = {name: value.detach() for name, value in params.items()}
        next_q = functional_call(model, detached, (batch.next_frames,)) if double else next_q_target
        goal = td_target(batch.rewards, batch.terminated, next_q, next_q_target, discount, double=double)
        return td_loss(functional_call(model, params, (batch.frames,)), batch.actions, goal.detach())

    return loss


def _repeated(kind: Kind, loss: Loss[TensorBatch], count: int) -> None:
    for _ in range(count):
        kind(loss)


if __name__ == "__main__":
    main()
