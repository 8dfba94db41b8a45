"""Steps that better a hypothesis once an effect has been added."""
