"""Readings and reported interventions in; sudden changes of level out."""
