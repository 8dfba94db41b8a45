"""Diagnosis of free decays: which spring and which damping a structure has together."""
