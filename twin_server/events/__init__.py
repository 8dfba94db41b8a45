"""Events of assets, the deliveries of events, and the receivers they go to."""
