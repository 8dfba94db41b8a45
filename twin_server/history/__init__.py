"""States of a twin as arrays in; buckets of them and their JSON forms out."""
