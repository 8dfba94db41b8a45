"""Recognition of free decays, and what has to be left out of them."""
