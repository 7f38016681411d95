"""A meter in front of a broker that is not ours: passes bytes on, and counts them by client, direction and topic."""
