"""Records of imposed motion and measured force → the law of the element, without a free run."""
