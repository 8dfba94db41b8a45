"""Measured rigs with known answers → `docs/real_rigs.md`: slowtime beside other tools."""
