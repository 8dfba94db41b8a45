"""Which candidates are fitted, which is accepted, and how probable it is."""
