"""A scaled history and candidate laws in; inliers, and the terms of the best law, out."""
