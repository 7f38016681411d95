"""Each robot takes the coordinate-wise median of its cluster's models (Yin et al. 2018) in place of their mean.

In a scenario: `methods = ["fl", "median:Median"]` (see docs/doors.md). A robot whose weights are far off, because it is
broken or means harm, moves the mean by as much as it likes, and the median hardly.
"""

import numpy as np

from jouleswarm import Method


class Median(Method):
    name, label, colour = "median", "coordinate-wise median", "#009E73"

    def mix(self, own, theirs, step):
        """own: this robot's weights by tensor; theirs: neighbour -> its update, with `.weights` in the same form."""
        every = [own, *(update.weights for update in theirs.values())]
        return {key: np.median([each[key] for each in every], axis=0).astype(np.float32) for key in own}
