"""Candidates for the missing effect; each module proposes them from one kind of evidence."""
