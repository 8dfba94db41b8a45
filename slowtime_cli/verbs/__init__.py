"""Arguments and help of each verb: words in, checked arguments out."""
