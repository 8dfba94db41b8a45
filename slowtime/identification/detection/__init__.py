"""A record in; significant resonance peaks, and series reduced to one of them, out."""
