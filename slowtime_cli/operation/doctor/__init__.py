"""Checks of the verb `doctor`: an installation and its surroundings → findings with advice."""
