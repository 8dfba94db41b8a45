"""Mode shapes in; correlation criteria, and shapes merged over set-ups, out."""
