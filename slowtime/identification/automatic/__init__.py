"""A record of many channels in; all its modes with standard deviations out."""
