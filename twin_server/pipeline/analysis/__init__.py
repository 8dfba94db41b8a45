"""Histories of twins in; forecasts, risk, plans, simulations and fatigue out, cached."""
