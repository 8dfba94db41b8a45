"""Names of methods of identification, by what they read."""

ALL_CHANNELS = ("modes", "bayes", "efdd", "fdd")
"""Methods that find the modes of all channels together, with shapes."""
