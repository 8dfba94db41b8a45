"""Records of boards with clocks of their own in; one record on one clock out."""
