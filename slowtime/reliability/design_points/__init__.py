"""A limit state in; its design points and approximations of failure probability out."""
