"""The experiment that tells hypotheses apart which the records cannot."""
