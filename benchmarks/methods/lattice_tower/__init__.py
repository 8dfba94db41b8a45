"""A lattice tower of trusses and beams made by pyfe3d: its matrices → figures of the twin."""
