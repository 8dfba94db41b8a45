"""A house of four storeys over ten years, and what its twin makes of it, in one run."""
