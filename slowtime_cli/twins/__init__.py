"""Verbs on the history of a twin: evolve, forecast, plan, risk, export and others."""
