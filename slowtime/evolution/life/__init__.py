"""A forecast and a threshold in; the distribution of the remaining life out."""
