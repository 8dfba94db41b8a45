"""What travels: the messages, their streams and their versions."""
