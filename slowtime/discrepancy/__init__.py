"""Records and a model in; where they disagree, and with what statistic, out."""
