"""A model file and the quantities asked of it in, a virtual sensor out."""
