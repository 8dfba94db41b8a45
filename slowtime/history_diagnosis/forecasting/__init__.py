"""Selected terms in; a mixture of laws, and its predictions of later readings, out."""
