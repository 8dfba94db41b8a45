"""Options, terminal output and inputs that several verbs have in common."""
