"""A series of two slow time scales in; one component for each scale out."""
