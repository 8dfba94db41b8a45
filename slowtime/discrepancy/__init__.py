"""Records and a model in; where they disagree, and with what statistic, out.

Wherever `kinds` is a parameter, it is the catalogue of effects that may be named, by name.
"""
