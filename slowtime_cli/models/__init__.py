"""Verbs on a model or a problem file: diagnose, design, reliability, surrogate and others."""
