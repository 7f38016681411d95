"""A network of one's own, one wide layer: --set network.build=wide_network:build --set network.kwargs.width=256"""

from torch import nn

from jouleswarm import QNetwork


def build(observation, actions, settings):
    """`observation`: a gymnasium Box, float32, of what the network is fed; `settings`: the table [network]."""
    width = settings.kwargs.get("width", 128)
    return QNetwork(nn.Flatten(), nn.Linear(observation.shape[0], width), nn.Tanh(), nn.Linear(width, actions))
