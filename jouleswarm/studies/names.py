"""Names of the studies and what they are, apart from their code: the command line shows them without loading it."""

from __future__ import annotations

from typing import Literal, get_args

StudyName = Literal["paper", "baselines", "sensitivity", "regimes", "similarity", "codecs", "experience"]

_HELP = (
    "The paper's Table II and its Figs. 3 and 4: rounds and energy against t0, MAML exact, first-order MAML and joint "
    "training beside learning without transfer. 15 seeds. --t0: of the break-even map; without it the best one that "
    "ran at each point.",
    "All methods side by side, and one robot a task: rounds, success, joules by cause, bits. 15 seeds, t0 = 90.",
    "Training tasks, cluster size, topology, batches a round, one at a time. 5 seeds, t0 = 90.",
    "The scenario's own learner against the authors' (slow, target copied rarely), theirs in earnest, and one that "
    "explores more. 8 seeds, t0 = 90.",
    "Families of tasks from far to near: what transfer saves against what their paths share. 5 seeds, t0 = 90.",
    "Ways to encode weights and experience: bytes, rounds and joules. 5 seeds, t0 = 90.",
    "How experience is collected: by a guide or by the own policy, random actions, starts; what each choice is worth "
    "with and without transfer. 5 seeds, t0 = 90.",
)
STUDIES: dict[StudyName, str] = dict(zip(get_args(StudyName), _HELP, strict=True))
