"""A free decay in; frequency and damping of its modes by maximum likelihood out."""
