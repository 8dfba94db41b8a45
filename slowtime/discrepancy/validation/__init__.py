"""What a model does on data it was not fitted to, and whether a free force does better."""
