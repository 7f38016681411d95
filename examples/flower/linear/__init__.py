"""A Flower app of two clients that learn a linear model, metered."""
