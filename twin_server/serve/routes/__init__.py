"""Routes of REST: parameters in, rendered answers out."""
