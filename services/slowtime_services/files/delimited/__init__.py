"""Lines of text in; its encoding, dialect of rows and names of columns out."""
