"""A spectrum of ambient response in; frequency and damping of a mode by its likelihood out."""
