"""A record of many channels in; stable poles and shapes of subspace identification out."""
