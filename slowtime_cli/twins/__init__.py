"""Verbs on what a twin knows: evolve, forecast, plan, risk, export and others."""
