"""The current structure and a load in; its simulated response with bands out."""
