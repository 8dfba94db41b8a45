"""Files as loggers, laboratories and rigs write them, with the right answer beside each."""
