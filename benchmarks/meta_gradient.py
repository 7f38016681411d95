"""beta of eq. (9): an exact meta-gradient (gradient through gradient) against a first-order one, both in one run.

python -m benchmarks.meta_gradient [--scenario scenarios/quick.toml] [--out results/beta/compact.csv]
"""

from __future__ import annotations

from pathlib import Path

from benchmarks.harness import parser, write_rows
from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.methods.beta import measure_beta

_COLUMNS = ("method", "inner_steps", "exact_s", "first_order_s", "ratio", "beta_time", "beta_flops")


def main() -> None:
    known = parser(__doc__)
    known.add_argument("--scenario", type=Path, default=Path("scenarios/quick.toml"))
    known.add_argument("--inner-steps", type=int, nargs="+", default=[1, 5, 10])
    known.add_argument("--repeats", type=int, default=9)
    known.add_argument("--out", type=Path, help="write the table as CSV too")
    arguments = known.parse_args()
    use_one_thread()
    scenario = load_scenario(arguments.scenario)
    rows = []
    for method, adapts in {"maml": None, "anil": head_of(build_qnetwork(scenario))}.items():
        for inner in arguments.inner_steps:
            cost = measure_beta(scenario, adapts, inner, arguments.repeats)
            ratio = cost.exact_s / cost.first_order_s
            figures = (cost.exact_s, cost.first_order_s, ratio, cost.beta_time, cost.beta_flops)
            rows.append((method, inner, *(f"{each:.4g}" for each in figures)))
    for row in (_COLUMNS, *rows):
        print("  ".join(f"{cell!s:>13}" for cell in row))
    write_rows(arguments.out, _COLUMNS, rows)


if __name__ == "__main__":
    main()
