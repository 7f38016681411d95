# %% [markdown]
# # What does it cost, and who pays?
# Each cell is run on its own in an editor that knows `# %%`, all of them by `python examples/notebook.py`.

# %% A run: a scenario's name, a file, or a dict; here a short one of the toy. It ends with the run.
import pandas as pd

from jouleswarm import Run, literal, run

pd.set_option("display.width", 120, "display.max_columns", None)
short = {"meta.t0": 2, "federation.max_rounds": 3, "learning.motions_per_round": 6, "learning.batches_per_round": 4}
done = run("toy", seed=3, set=short)

# %% Rounds until each task was learned, or given up
print(done.rounds.query("phase == 'fl'").groupby(["arm", "task"])["round"].max())

# %% Bytes that the broker delivered, by arm and link
delivered = done.meter.query("side == 'broker' and direction == 'out'")
print(delivered.groupby(["arm", "link"])[["messages", "payload_bytes"]].sum())

# %% The bill: joules, a row an arm, a column a phase and cause
bill = done.bill()
print(bill["ml"].round(2), bill["fl"].round(2), bill.sum(axis="columns"), sep="\n")

# %% The same at an uplink ten times as dear, and with half the power in the data center: nothing is trained again
print((done.bill(ul_bit_per_j=20e3) / bill)["ml"]["uplink"])
print(done.bill(p0_w=295).sum(axis="columns") - bill.sum(axis="columns"))


# %% A price list of one's own: the equations, and 2 W that a robot draws in all of its rounds
class Standby:
    name, label = "standby", "with 2 W of standby"

    def price(self, facts, energy):
        idle = {"ml": 0.0, "fl": 0.0}
        for work in facts.work:
            if work.robot:
                idle[work.phase] += 2.0 * work.seconds
        return literal.price(facts, energy).plus(ml={"other_robots_j": idle["ml"]}, fl={"other_robots_j": idle["fl"]})


print(done.bill(Standby())["fl"].round(2))

# %% Later, or elsewhere: the directory is all that is needed
again = Run(done.path)
print(again, again.scenario.seed, again.facts("maml").counts.ml, sep="\n")
