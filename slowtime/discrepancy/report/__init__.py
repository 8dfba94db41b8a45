"""The diagnosis put together from the hypothesis that the search ended with."""
