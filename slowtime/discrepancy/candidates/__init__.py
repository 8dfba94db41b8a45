"""Recovered forces and motions in, effects of the library that explain them out."""
