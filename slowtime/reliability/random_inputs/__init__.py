"""Marginal distributions and copulas in; maps from standard normal space out."""
