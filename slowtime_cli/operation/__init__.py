"""Verbs that run the processes of a site, and keep their keys, databases and recordings."""
