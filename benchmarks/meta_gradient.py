"""beta of eq. (9): an exact meta-gradient (gradient through gradient) against a first-order one, both in one run.

python -m benchmarks.meta_gradient [--scenario scenarios/quick.toml] [--out results/beta/compact.csv]
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

from jouleswarm.common.process import use_one_thread
from jouleswarm.common.scenario.reading import load_scenario
from jouleswarm.learning.heads import head_of
from jouleswarm.learning.networks import build_qnetwork
from jouleswarm.methods.beta import measure_beta

_COLUMNS = ("method", "inner_steps", "exact_s", "first_order_s", "ratio", "beta_time", "beta_flops")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", type=Path, default=Path("scenarios/quick.toml"))
    parser.add_argument("--inner-steps", type=int, nargs="+", default=[1, 5, 10])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--out", type=Path, help="write the table as CSV too")
    arguments = parser.parse_args()
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
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        with arguments.out.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows((_COLUMNS, *rows))


if __name__ == "__main__":
    main()
