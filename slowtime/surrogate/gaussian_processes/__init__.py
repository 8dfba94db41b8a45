"""A design and its outputs in; Gaussian-process surrogates out."""
