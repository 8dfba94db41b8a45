"""What each verb takes and says of itself; words in, checked arguments out."""
